// map.png, decoded again with libpng's simplified reader.
#include "slam/output/map_picture.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <limits>

#include "slam/output/internal/canvas.hpp"
#include "slam/output/internal/font.hpp"
#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

using internal::Color;
using testing::HasSubstr;

struct Picture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> pixels;
  double m_per_px = 0.0;  // from the text chunks
  double left_m = 0.0;
  double bottom_m = 0.0;

  Color at(int x, int y) const {
    const std::size_t index =
        3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x));
    return {pixels.at(index), pixels.at(index + 1), pixels.at(index + 2)};
  }
  // Pixel of a point in the map, by what the file says of itself.
  Color at_m(double x_m, double y_m) const {
    return at(static_cast<int>(std::floor((x_m - left_m) / m_per_px)),
              height - 1 - static_cast<int>(std::floor((y_m - bottom_m) / m_per_px)));
  }
};

std::string text_chunk(const std::string& bytes, const std::string& keyword) {
  const std::size_t at = bytes.find("tEXt" + keyword + '\0');
  if (at == std::string::npos) return "missing";
  std::size_t length = 0;
  for (std::size_t i = at - 4; i < at; ++i) length = 256 * length + static_cast<std::uint8_t>(bytes[i]);
  return bytes.substr(at + 4 + keyword.size() + 1, length - keyword.size() - 1);
}

Picture read_png(const std::filesystem::path& path) {
  Picture picture;
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&image, path.c_str()), 0) << image.message;
  EXPECT_EQ(image.format, static_cast<png_uint_32>(PNG_FORMAT_RGB)) << "the file itself is RGB";
  image.format = PNG_FORMAT_RGB;
  picture.width = static_cast<int>(image.width);
  picture.height = static_cast<int>(image.height);
  picture.pixels.resize(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, picture.pixels.data(), 0, nullptr), 0) << image.message;
  const std::string bytes = read_text(path);
  picture.m_per_px = std::stod(text_chunk(bytes, "Resolution"));
  const std::string origin = text_chunk(bytes, "Origin");
  picture.left_m = std::stod(origin);
  picture.bottom_m = std::stod(origin.substr(origin.find(' ')));
  return picture;
}

int brightness(Color c) {
  return (c.r + c.g + c.b) / 3;
}
int saturation(Color c) {
  return std::max({c.r, c.g, c.b}) - std::min({c.r, c.g, c.b});
}

// A free room of width x height cells with walls of one cell around it, unknown cells outside.
MapImage room(int width, int height, int unknown_border) {
  MapImage map{0.05, -2.0, 1.0, width + 2 * unknown_border, height + 2 * unknown_border, {}};
  map.cells.assign(static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height), 0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool wall = x == 0 || y == 0 || x == width - 1 || y == height - 1;
      const int index = (y + unknown_border) * map.width + x + unknown_border;
      map.cells[static_cast<std::size_t>(index)] = wall ? 255 : 1;
    }
  }
  return map;
}

TEST(MapPictureTest, ShowsWallsFreeSpacePathAndLoopsWhereTheyAre) {
  const ScratchFolder folder;
  const MapImage map = room(400, 300, 20);  // 20 m x 15 m; lower-left corner of the room at (-1, 2)
  const std::vector<Pose2> path{{1.0, 4.0, 0.0}, {15.0, 4.0, 0.0}};
  const PictureInput input{map,
                           path,
                           {{0, {1.0, 8.0, 0.0}}, {1, {15.0, 8.0, 0.0}}},
                           {{{1.0, 10.0}, {15.0, 10.0}, true}, {{1.0, 12.0}, {15.0, 12.0}, false}},
                           "room - 14 m, 2 sub-maps, 1 loop",
                           "submapd 0.1.0"};
  ASSERT_TRUE(write_map_picture(folder.path() / "map.png", input).ok());
  const Picture picture = read_png(folder.path() / "map.png");
  EXPECT_GE(std::max(picture.width, picture.height), 1200);
  EXPECT_LE(std::max(picture.width, picture.height), 2400);

  EXPECT_LT(brightness(picture.at_m(-0.975, 9.0)), 60) << "left wall";
  EXPECT_LT(brightness(picture.at_m(5.0, 2.025)), 60) << "lower wall";
  EXPECT_LT(brightness(picture.at_m(5.0, 16.975)), 60) << "upper wall";
  EXPECT_EQ(picture.at_m(5.0, 6.0), (Color{255, 255, 255})) << "free space";
  const Color outside = picture.at_m(-1.2, 9.0);
  EXPECT_LT(saturation(outside), 20);
  EXPECT_GT(brightness(outside), 180);
  EXPECT_LT(brightness(outside), 235);

  const Color early = picture.at_m(2.0, 4.0);
  const Color late = picture.at_m(14.0, 4.0);
  EXPECT_GT(saturation(early), 80) << "the path has a colour";
  EXPECT_EQ(early, late) << "two poses make one segment";
  EXPECT_EQ(picture.at_m(5.0, 4.3), (Color{255, 255, 255})) << "the path is thin";

  const Color confirmed = picture.at_m(8.0, 10.0);
  EXPECT_GT(confirmed.g, confirmed.r + 50);
  int red = 0;
  int white = 0;
  for (double x_m = 3.0; x_m < 13.0; x_m += 0.05) {
    const Color color = picture.at_m(x_m, 12.0);
    red += color.r > 200 && color.g < 100 ? 1 : 0;
    white += color == Color{255, 255, 255} ? 1 : 0;
  }
  EXPECT_GT(red, 50) << "a pending loop is dashed";
  EXPECT_GT(white, 20) << "a pending loop is dashed";
  int title = 0;
  for (int y = 0; y < 50; ++y) {
    for (int x = 0; x < picture.width / 2; ++x) title += brightness(picture.at(x, y)) < 100 ? 1 : 0;
  }
  EXPECT_GT(title, 200) << "there is a title";
}

TEST(MapPictureTest, ThePathRunsThroughItsColours) {
  const ScratchFolder folder;
  const MapImage map = room(400, 300, 0);
  std::vector<Pose2> path;
  for (int i = 0; i <= 1000; ++i) path.push_back({-1.0 + 0.018 * i, 8.0, 0.0});
  ASSERT_TRUE(write_map_picture(folder.path() / "map.png", {map, path, {}, {}, "", ""}).ok());
  const Picture picture = read_png(folder.path() / "map.png");
  const Color early = picture.at_m(0.0, 8.0);
  const Color late = picture.at_m(16.0, 8.0);
  EXPECT_GT(early.b, early.r + 50);
  EXPECT_GT(late.r, late.b + 50);
}

TEST(MapPictureTest, ABigMapStaysBoundedAndKeepsItsThinWalls) {
  const ScratchFolder folder;
  const MapImage map = room(6000, 6000, 0);
  ASSERT_TRUE(write_map_picture(folder.path() / "map.png", {map, {}, {}, {}, "big", ""}).ok());
  const Picture picture = read_png(folder.path() / "map.png");
  EXPECT_GE(std::max(picture.width, picture.height), 1200);
  EXPECT_LE(std::max(picture.width, picture.height), 2400);
  for (double along_m = 10.0; along_m < 290.0; along_m += 0.37) {
    ASSERT_LT(brightness(picture.at_m(-2.0 + 0.025, 1.0 + along_m)), 60) << along_m;
    ASSERT_LT(brightness(picture.at_m(-2.0 + along_m, 301.0 - 0.025)), 60) << along_m;
  }
}

TEST(MapPictureTest, LongAndTinyMapsKeepToTheSizes) {
  const ScratchFolder folder;
  const struct {
    int width;
    int height;
    int least;
  } cases[] = {{4000, 400, 1200}, {400, 4000, 1200}, {20000, 3, 1200}, {3, 20000, 1200}, {100, 100, 800}, {1, 1, 100}};
  for (const auto& c : cases) {
    const MapImage map = room(c.width, c.height, 0);
    ASSERT_TRUE(write_map_picture(folder.path() / "map.png", {map, {}, {}, {}, "", ""}).ok());
    const Picture picture = read_png(folder.path() / "map.png");
    EXPECT_GE(std::max(picture.width, picture.height), c.least) << c.width << " x " << c.height;
    EXPECT_LE(std::max(picture.width, picture.height), 2400) << c.width << " x " << c.height;
  }
}

TEST(MapPictureTest, CropsToTheKnownCells) {
  const ScratchFolder folder;
  const MapImage map = room(300, 300, 1000);
  ASSERT_TRUE(write_map_picture(folder.path() / "map.png", {map, {}, {}, {}, "", ""}).ok());
  const Picture picture = read_png(folder.path() / "map.png");
  EXPECT_LT(picture.width * picture.m_per_px, 20.0) << "the room is 15 m wide, the grid 115 m";
}

TEST(MapPictureTest, HostileInputIsDrawnOrLeftOut) {
  const ScratchFolder folder;
  const MapImage map = room(100, 100, 0);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double huge = 1e300;
  const std::vector<Pose2> path{{0, 2, 0}, {nan, 2, 0}, {huge, -huge, 0}, {-1e12, 1e12, 0}, {0, 3, nan}};
  const PictureInput input{map,
                           path,
                           {{4294967295U, {nan, 0, 0}}, {1, {huge, huge, huge}}, {2, {0, 2, nan}}},
                           {{{-huge, 0}, {huge, 0}, false}, {{nan, 0}, {0, 0}, true}, {{-1e15, 2}, {1e15, 2}, false}},
                           std::string("\xff\n\0name", 7) + std::string(5000, 'W'),
                           "\x01"};
  ASSERT_TRUE(write_map_picture(folder.path() / "map.png", input).ok());
  EXPECT_LE(read_png(folder.path() / "map.png").width, 2400);
}

TEST(MapPictureTest, SameInputSameBytes) {
  const ScratchFolder folder;
  const MapImage map = room(100, 80, 2);
  const std::vector<Pose2> path{{0, 2, 0}, {1, 3, 1}};
  const PictureInput input{map, path, {{0, {0, 2, 0}}}, {}, "a", "b"};
  ASSERT_TRUE(write_map_picture(folder.path() / "1.png", input).ok());
  ASSERT_TRUE(write_map_picture(folder.path() / "2.png", input).ok());
  EXPECT_EQ(read_text(folder.path() / "1.png"), read_text(folder.path() / "2.png"));
}

TEST(MapPictureTest, WriteErrorsNameThePathAndLeaveNothing) {
  const ScratchFolder folder;
  const MapImage map = room(100, 80, 0);
  const std::filesystem::path missing = folder.path() / "missing" / "map.png";
  const Status status = write_map_picture(missing, {map, {}, {}, {}, "", ""});
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), HasSubstr(missing.string()));
  const MapImage empty;
  EXPECT_EQ(write_map_picture(folder.path() / "map.png", {empty, {}, {}, {}, "", ""}).code(),
            StatusCode::kInvalidArgument);
  EXPECT_EQ(folder.entries(), 0U);
}

// Lets files of this process grow to `bytes` at most while it lives: writes beyond fail as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    handler_ = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*handler_)(int) = nullptr;
};

TEST(MapPictureTest, AFullDiskInTheMiddleOfTheFileIsAnErrorAndLeavesNothing) {
  const ScratchFolder folder;
  const MapImage map = room(100, 80, 0);
  for (const rlim_t bytes : {0U, 20U, 1000U, 3000U}) {
    Status status;
    {
      const FileSizeLimit limit(bytes);
      status = write_map_picture(folder.path() / "map.png", {map, {}, {}, {}, "", ""});
    }
    EXPECT_EQ(status.code(), StatusCode::kIo) << bytes;
    EXPECT_THAT(status.message(), HasSubstr((folder.path() / "map.png").string()));
    EXPECT_EQ(folder.entries(), 0U);
  }
}

TEST(PictureTitleTest, ReadsWell) {
  EXPECT_EQ(picture_title("hall", 312.4, 14, 3), "hall - 312 m, 14 sub-maps, 3 loops");
  EXPECT_EQ(picture_title("a", 1.6, 1, 1), "a - 2 m, 1 sub-map, 1 loop");
}

TEST(FontTest, EveryPrintableCharacterHasItsOwnGlyph) {
  for (char a = ' '; a <= '~'; ++a) {
    const internal::Glyph glyph = internal::glyph_of(a);
    EXPECT_GE(glyph.columns, 1);
    EXPECT_LE(glyph.first_column + glyph.columns, internal::kGlyphColumns);
    for (char b = static_cast<char>(a + 1); b <= '~'; ++b) {
      const bool same = glyph.rows == internal::glyph_of(b).rows;
      EXPECT_EQ(same, a == '0' && b == 'O') << a << " and " << b;
    }
  }
  EXPECT_EQ(internal::glyph_of('\xe4').rows, internal::glyph_of('?').rows);
}

TEST(CanvasTest, ALineCoversItsWidthAndNoMore) {
  internal::Canvas canvas(20, 10, {255, 255, 255});
  canvas.line({-5.0, 5.0}, {40.0, 5.0}, 2.0, {0, 0, 0});
  for (int x = 0; x < 20; ++x) {
    EXPECT_EQ(canvas.at(x, 3), (Color{255, 255, 255}));
    EXPECT_EQ(canvas.at(x, 4), (Color{0, 0, 0}));
    EXPECT_EQ(canvas.at(x, 5), (Color{0, 0, 0}));
    EXPECT_EQ(canvas.at(x, 6), (Color{255, 255, 255}));
  }
}

TEST(CanvasTest, ADiscHasItsArea) {
  internal::Canvas canvas(40, 40, {0, 0, 0});
  canvas.disc({20.3, 19.6}, 10.0, {255, 255, 255});
  double area = 0.0;
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) area += canvas.at(x, y).r / 255.0;
  }
  EXPECT_NEAR(area, 100.0 * std::numbers::pi, 3.0);
}

}  // namespace
}  // namespace submapd
