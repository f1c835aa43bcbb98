#include "slam/base/atomic_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

class AtomicFileTest : public testing::Test {
 protected:
  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) names.push_back(entry.path().filename());
    return names;
  }
  std::string content(const std::string& name) const {
    std::ifstream file(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
};

TEST_F(AtomicFileTest, AppearsOnlyWithCommit) {
  AtomicFile file(folder_ / "map.pgm");
  ASSERT_TRUE(file.write("first ").ok());
  ASSERT_TRUE(file.write("second").ok());
  EXPECT_THAT(names(), testing::Not(testing::Contains("map.pgm")));
  ASSERT_TRUE(file.commit().ok());
  EXPECT_THAT(names(), testing::ElementsAre("map.pgm"));
  EXPECT_EQ(content("map.pgm"), "first second");
}

TEST_F(AtomicFileTest, WithoutCommitTheOldFileStaysAndNoTemporary) {
  ASSERT_TRUE(atomic_write_file(folder_ / "map.pgm", std::as_bytes(std::span("old", 3))).ok());
  {
    AtomicFile file(folder_ / "map.pgm");
    ASSERT_TRUE(file.write("new").ok());
  }
  EXPECT_THAT(names(), testing::ElementsAre("map.pgm"));
  EXPECT_EQ(content("map.pgm"), "old");
}

TEST_F(AtomicFileTest, TwoWritersOfOneNameDoNotMix) {
  AtomicFile a(folder_ / "map.pgm");
  AtomicFile b(folder_ / "map.pgm");
  ASSERT_TRUE(a.write("a").ok());
  ASSERT_TRUE(b.write("b").ok());
  ASSERT_TRUE(b.commit().ok());
  ASSERT_TRUE(a.commit().ok());
  EXPECT_EQ(content("map.pgm"), "a");
}

TEST_F(AtomicFileTest, MissingFolderIsAnErrorThatNamesTheFile) {
  AtomicFile file(folder_ / "missing" / "map.pgm");
  const Status status = file.write("x");
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), testing::HasSubstr("missing/map.pgm"));
  EXPECT_EQ(file.commit().code(), StatusCode::kIo);
}

TEST_F(AtomicFileTest, TargetThatIsAFolderLeavesNoTemporary) {
  std::filesystem::create_directory(folder_ / "taken");
  AtomicFile file(folder_ / "taken");
  ASSERT_TRUE(file.write("x").ok());
  EXPECT_EQ(file.commit().code(), StatusCode::kIo);
  EXPECT_THAT(names(), testing::ElementsAre("taken"));
}

TEST_F(AtomicFileTest, SecondCommitIsAnError) {
  AtomicFile file(folder_ / "map.pgm");
  ASSERT_TRUE(file.commit().ok());
  EXPECT_FALSE(file.commit().ok());
  EXPECT_EQ(content("map.pgm"), "");
}

}  // namespace
}  // namespace submapd
