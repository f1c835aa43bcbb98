// A map appears whole or not at all, and another one is replaced only if that is wanted.
#include "daemon/map_folder.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <span>

#include "slam/base/sha256.hpp"
#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

using nlohmann::json;

class MapFolderTest : public testing::Test {
 protected:
  // Writes a map with one file of that text.
  Status save(const std::string& text, bool replace) {
    Expected<MapFolder> folder = MapFolder::begin(maps(), "hall", replace);
    if (!folder) return folder.error();
    std::ofstream(folder->aside() / "map.pgm") << text;
    EXPECT_EQ(before_commit(), text);
    return folder->commit({{"format", 1}});
  }
  std::string before_commit() {
    std::string text;
    for (const auto& entry : std::filesystem::directory_iterator(maps())) {
      if (entry.path().filename().string().starts_with(".hall.")) std::ifstream(entry.path() / "map.pgm") >> text;
    }
    return text;
  }
  json manifest() { return json::parse(std::ifstream(maps() / "hall" / "MANIFEST"), nullptr, false); }
  std::size_t entries() {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(maps()), {}));
  }
  const std::filesystem::path& maps() { return folder_.path(); }
  TemporaryFolder folder_;
};

TEST_F(MapFolderTest, CommittedItIsThereWithItsHashes) {
  ASSERT_TRUE(save("one", false).ok());
  const json listed = manifest();
  ASSERT_EQ(listed["files"].size(), 1U);
  EXPECT_EQ(listed["format"], 1);
  EXPECT_EQ(listed["files"][0]["name"], "map.pgm");
  EXPECT_EQ(listed["files"][0]["bytes"], 3);
  const std::string one = "one";
  EXPECT_EQ(listed["files"][0]["sha256"], hex_of(*sha256_of(std::as_bytes(std::span(one)))));
  EXPECT_EQ(entries(), 1U);
}

TEST_F(MapFolderTest, NotCommittedNothingIsLeft) {
  {
    Expected<MapFolder> folder = MapFolder::begin(maps(), "hall", false);
    ASSERT_TRUE(folder.has_value());
    std::ofstream(folder->aside() / "map.pgm") << "one";
  }
  EXPECT_EQ(entries(), 0U);
}

TEST_F(MapFolderTest, AnotherMapIsReplacedOnlyIfWanted) {
  ASSERT_TRUE(save("one", false).ok());
  EXPECT_EQ(save("two", false).code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(manifest()["files"][0]["bytes"], 3);
  ASSERT_TRUE(save("three", true).ok());
  EXPECT_EQ(manifest()["files"][0]["bytes"], 5);
  EXPECT_EQ(entries(), 1U) << "the old one is gone";
  std::filesystem::remove_all(maps() / "hall");
  ASSERT_TRUE(save("four", true).ok()) << "there need not be one";
}

TEST_F(MapFolderTest, AMapThatAppearsMeanwhileIsNotOverwritten) {
  Expected<MapFolder> folder = MapFolder::begin(maps(), "hall", false);
  ASSERT_TRUE(folder.has_value());
  ASSERT_TRUE(save("first", false).ok());
  EXPECT_EQ(folder->commit({}).code(), StatusCode::kIo);
  EXPECT_EQ(manifest()["files"][0]["bytes"], 5);
}

TEST_F(MapFolderTest, BadNamesAndMissingFoldersAreTold) {
  EXPECT_EQ(MapFolder::begin(maps(), "../hall", false).error().code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(MapFolder::begin(maps() / "gone", "hall", false).error().code(), StatusCode::kIo);
}

}  // namespace
}  // namespace submapd
