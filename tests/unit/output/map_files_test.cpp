// map.pgm and map.yaml, read back by a small loader under both rules in use.
#include "slam/output/map_files.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <limits>
#include <sstream>

#include "slam/submap/finished_submap.hpp"
#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

using testing::HasSubstr;

struct Pgm {
  int width = 0;
  int height = 0;
  std::string pixels;  // row 0 on top

  int at(int column, int row) const {
    return static_cast<std::uint8_t>(pixels.at(static_cast<std::size_t>(row * width + column)));
  }
};

Pgm read_pgm(const std::filesystem::path& path) {
  const std::string text = read_text(path);
  std::istringstream in(text);
  std::string magic;
  int most = 0;
  Pgm pgm;
  in >> magic >> pgm.width >> pgm.height >> most;
  EXPECT_EQ(magic, "P5");
  EXPECT_EQ(most, 255);
  pgm.pixels = text.substr(static_cast<std::size_t>(in.tellg()) + 1);
  EXPECT_EQ(pgm.pixels.size(), static_cast<std::size_t>(pgm.width * pgm.height));
  return pgm;
}

// What follows "key: " in a flat YAML file.
std::string yaml_value(const std::string& yaml, const std::string& key) {
  const std::size_t start = yaml.find("\n" + key + ": ");
  if (start == std::string::npos) return "missing";
  const std::size_t value = start + key.size() + 3;
  return yaml.substr(value, yaml.find('\n', value) - value);
}

constexpr int kOccupied = 100;
constexpr int kFree = 0;
constexpr int kUnknown = -1;

int load_strict(int pixel, double occupied, double free) {  // nav2
  const double p = (255 - pixel) / 255.0;
  return p > occupied ? kOccupied : p < free ? kFree : kUnknown;
}
int load_inclusive(int pixel, double occupied, double free) {  // ROS 1's header comment
  const double p = (255 - pixel) / 255.0;
  return p >= occupied ? kOccupied : p <= free ? kFree : kUnknown;
}

// 16 x 16 cells, one of each byte: cell (x, y) holds 16 y + x.
MapImage every_byte() {
  MapImage map{0.05, -12.35, 3.0, 16, 16, {}};
  for (int cell = 0; cell < 256; ++cell) map.cells.push_back(static_cast<std::uint8_t>(cell));
  return map;
}

TEST(MapFilesTest, BothLoaderRulesReproduceTheClassOfEveryByte) {
  const ScratchFolder folder;
  const MapImage map = every_byte();
  ASSERT_TRUE(write_map_files(folder.path(), map).ok());
  const std::string yaml = "\n" + read_text(folder.path() / "map.yaml");
  const Pgm pgm = read_pgm(folder.path() / yaml_value(yaml, "image"));
  const double occupied = std::atof(yaml_value(yaml, "occupied_thresh").c_str());
  const double free = std::atof(yaml_value(yaml, "free_thresh").c_str());
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::uint8_t cell = map.at(x, y);
      const double p = occupancy_of(cell);
      const int expected = cell == 0 ? kUnknown : p > 0.65 ? kOccupied : p < 0.196 ? kFree : kUnknown;
      const int pixel = pgm.at(x, map.height - 1 - y);
      EXPECT_EQ(load_strict(pixel, occupied, free), expected) << "cell byte " << int{cell};
      EXPECT_EQ(load_inclusive(pixel, occupied, free), expected) << "cell byte " << int{cell};
      EXPECT_TRUE(pixel == 0 || pixel == 205 || pixel == 254) << pixel;
    }
  }
}

TEST(MapFilesTest, ThresholdsSplitWhereTheySay) {
  EXPECT_EQ(map_pixel(0), 205);
  EXPECT_EQ(map_pixel(1), 254);
  EXPECT_EQ(map_pixel(50), 254);  // p = 49 / 254 = 0.1929
  EXPECT_EQ(map_pixel(51), 205);  // p = 50 / 254 = 0.1969
  EXPECT_EQ(map_pixel(128), 205);
  EXPECT_EQ(map_pixel(166), 205);  // p = 165 / 254 = 0.6496
  EXPECT_EQ(map_pixel(167), 0);    // p = 166 / 254 = 0.6535
  EXPECT_EQ(map_pixel(255), 0);
}

TEST(MapFilesTest, YamlSaysHowToReadTheImage) {
  const ScratchFolder folder;
  ASSERT_TRUE(write_map_files(folder.path(), every_byte()).ok());
  const std::string yaml = "\n" + read_text(folder.path() / "map.yaml");
  EXPECT_EQ(yaml_value(yaml, "image"), "map.pgm");
  EXPECT_EQ(yaml_value(yaml, "mode"), "trinary");
  EXPECT_EQ(yaml_value(yaml, "resolution"), "0.05");
  EXPECT_EQ(yaml_value(yaml, "origin"), "[-12.35, 3.0, 0.0]");
  EXPECT_EQ(yaml_value(yaml, "negate"), "0");
  EXPECT_EQ(yaml_value(yaml, "occupied_thresh"), "0.65");
  EXPECT_EQ(yaml_value(yaml, "free_thresh"), "0.196");
}

TEST(MapFilesTest, TopRowOfTheImageHasTheLargestY) {
  const ScratchFolder folder;
  MapImage map{0.1, 0.0, 0.0, 3, 2, std::vector<std::uint8_t>(6, 1)};
  map.cells[5] = 255;  // x = 2, y = 1: upper right
  map.cells[0] = 0;    // lower left
  ASSERT_TRUE(write_map_files(folder.path(), map).ok());
  const Pgm pgm = read_pgm(folder.path() / "map.pgm");
  EXPECT_EQ(pgm.width, 3);
  EXPECT_EQ(pgm.height, 2);
  EXPECT_EQ(pgm.at(2, 0), 0);
  EXPECT_EQ(pgm.at(0, 1), 205);
  EXPECT_EQ(pgm.at(0, 0), 254);
}

TEST(MapFilesTest, WritesAMapOf6000By6000) {
  const ScratchFolder folder;
  MapImage map{0.05, 0.0, 0.0, 6000, 6000, std::vector<std::uint8_t>(36'000'000, 1)};
  map.cells.back() = 255;
  ASSERT_TRUE(write_map_files(folder.path(), map).ok());
  const Pgm pgm = read_pgm(folder.path() / "map.pgm");
  EXPECT_EQ(pgm.at(5999, 0), 0);
  EXPECT_EQ(pgm.at(0, 5999), 254);
}

TEST(MapFilesTest, AMissingFolderIsAnErrorWithThePath) {
  const ScratchFolder folder;
  const Status status = write_map_files(folder.path() / "missing", every_byte());
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), HasSubstr((folder.path() / "missing" / "map.pgm").string()));
}

TEST(MapFilesTest, WhenTheImageCannotBeWrittenThereIsNoYaml) {
  const ScratchFolder folder;
  std::filesystem::create_directory(folder.path() / "map.pgm");  // rename over a folder fails, for root too
  const Status status = write_map_files(folder.path(), every_byte());
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), HasSubstr("map.pgm"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "map.yaml"));
  EXPECT_EQ(folder.entries(), 1U) << "a temporary was left";
}

TEST(MapFilesTest, AFolderThatIsNotWritableIsAnError) {
  if (::geteuid() == 0) GTEST_SKIP() << "root may write anywhere";
  const ScratchFolder folder;
  std::filesystem::permissions(folder.path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  const Status status = write_map_files(folder.path(), every_byte());
  std::filesystem::permissions(folder.path(), std::filesystem::perms::owner_all);
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), HasSubstr((folder.path() / "map.pgm").string()));
}

TEST(MapFilesTest, MapsThatContradictThemselvesAreRefused) {
  const ScratchFolder folder;
  MapImage map = every_byte();
  map.cells.pop_back();
  EXPECT_EQ(write_map_files(folder.path(), map).code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(write_map_files(folder.path(), MapImage{}).code(), StatusCode::kInvalidArgument);
  map = every_byte();
  map.origin_x_m = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(write_map_files(folder.path(), map).code(), StatusCode::kInvalidArgument);
  map = every_byte();
  map.cell_m = 0.0;
  EXPECT_EQ(write_map_files(folder.path(), map).code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(folder.entries(), 0U);
}

}  // namespace
}  // namespace submapd
