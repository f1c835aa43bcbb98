// submapctl sensors --assign: the words it takes, and that the rest of the configuration stays as it is.
#include "tools/sensors/role_assignment.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "daemon/configuration.hpp"
#include "tests/support/temporary_folder.hpp"

namespace submapd::tools {
namespace {

using testing::HasSubstr;

TEST(RoleAssignment, TakesHWithOrWithoutV) {
  EXPECT_EQ(parse_assignment({"H=H0903971"})->horizontal, "H0903971");
  EXPECT_FALSE(parse_assignment({"H=H0903971"})->vertical.has_value());
  const auto both = parse_assignment({"V=00900001", "H=00903971"});
  ASSERT_TRUE(both.has_value());
  EXPECT_EQ(both->horizontal, "00903971");
  EXPECT_EQ(both->vertical, "00900001");
}

TEST(RoleAssignment, RefusesEverythingElse) {
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{{"V=00900001"},
                                                                                     {"H="},
                                                                                     {"H=1\"2"},
                                                                                     {"h=1"},
                                                                                     {"H"},
                                                                                     {""},
                                                                                     {"H=1", "H=2"},
                                                                                     {"H=00903971", "V=H0903971"},
                                                                                     {"H=12345678901234567"}}) {
    const auto roles = parse_assignment(words);
    ASSERT_FALSE(roles.has_value()) << testing::PrintToString(words);
    EXPECT_EQ(roles.error().code(), StatusCode::kInvalidArgument);
  }
}

TEST(RoleAssignment, AnEmptyFileGetsTheSection) {
  EXPECT_EQ(with_roles("", {"1", "2"}), "[scanner]\nvertical = \"2\"\nhorizontal = \"1\"\n");
}

TEST(RoleAssignment, OnlyTheFourKeysChange) {
  const std::string before =
      "# the cart of hall 3\n[filter]\nseed = 7\n[scanner] # ours\n  horizontal=\"old\"\nintensity = true\n"
      "horizontal_port = \"1-1\"\n\n[map]\ncell = 0.1\n";
  EXPECT_EQ(with_roles(before, {"1", "2"}),
            "# the cart of hall 3\n[filter]\nseed = 7\n[scanner] # ours\nvertical = \"2\"\nhorizontal = "
            "\"1\"\nintensity = true\n"
            "horizontal_port = \"\"\n\n[map]\ncell = 0.1\n");
}

TEST(RoleAssignment, NoVMeansThatThereIsNone) {
  EXPECT_EQ(with_roles("[scanner]\nvertical = \"2\"\n", {"1", std::nullopt}),
            "[scanner]\nhorizontal = \"1\"\nvertical = \"\"\n");
}

TEST(RoleAssignment, TheFileIsReadBackAndABrokenOneIsLeftAlone) {
  const TemporaryFolder folder;
  const std::string path = folder.path() / "submapd.toml";
  ASSERT_TRUE(assign_roles(path, {"H0903971", "00900001"}).ok());
  auto read = load_configuration(path);
  ASSERT_TRUE(read.has_value()) << read.error().message();
  EXPECT_EQ(read->scanner.roles[0].serial, "H0903971");
  EXPECT_EQ(read->scanner.roles[1].serial, "00900001");
  ASSERT_TRUE(assign_roles(path, {"00900001", std::nullopt}).ok());
  EXPECT_EQ(load_configuration(path)->scanner.roles[1].serial, "");

  std::ofstream(path) << "[scanner\n";
  const Status status = assign_roles(path, {"1", std::nullopt});
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr(path + ":1"));
  std::ifstream file(path);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), "[scanner\n");
}

}  // namespace
}  // namespace submapd::tools
