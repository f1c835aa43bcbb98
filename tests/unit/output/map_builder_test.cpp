// Scans laid down at poses end in the right cells, near the origin and far from it, within the byte limit.
#include "slam/output/map_builder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace submapd {
namespace {

constexpr std::size_t kPlenty = std::size_t{64} << 20;
constexpr int kMaxBeams = 2048;

// The inside of a room of 2 * half_x by 2 * half_y metres, seen all round from its middle.
Keyframe room(double half_x, double half_y) {
  Keyframe k;
  constexpr int kBeams = 1440;
  k.geometry.first_angle_rad = -std::numbers::pi;
  k.geometry.angle_step_rad = 2.0 * std::numbers::pi / kBeams;
  for (int i = 0; i < kBeams; ++i) {
    const double a = k.geometry.first_angle_rad + i * k.geometry.angle_step_rad;
    const double range =
        std::min(half_x / std::max(std::abs(std::cos(a)), 1e-9), half_y / std::max(std::abs(std::sin(a)), 1e-9));
    k.ranges_mm.push_back(static_cast<std::uint16_t>(std::lround(1000.0 * range)));
  }
  return k;
}

enum class Cell { kUnknown, kFree, kOccupied };

Cell cell_at_point(const MapImage& map, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor((p.x() - map.origin_x_m) / map.cell_m));
  const int y = static_cast<int>(std::floor((p.y() - map.origin_y_m) / map.cell_m));
  if (x < 0 || y < 0 || x >= map.width || y >= map.height) {
    ADD_FAILURE() << "(" << p.x() << ", " << p.y() << ") lies outside the map";
    return Cell::kUnknown;
  }
  const std::uint8_t cell = map.at(x, y);
  if (cell == 0) return Cell::kUnknown;
  return occupancy_of(cell) > 0.65 ? Cell::kOccupied : occupancy_of(cell) < 0.35 ? Cell::kFree : Cell::kUnknown;
}

MapImage build(const Keyframe& keyframe, const Pose2& pose, int times = 3, double cell_m = 0.05) {
  MapBuilder builder(cell_m, kPlenty, {}, kMaxBeams);
  builder.extend(keyframe, pose);
  builder.begin();
  for (int i = 0; i < times; ++i) builder.insert(keyframe, pose);
  return builder.image();
}

void expect_room(const MapImage& map, const Pose2& pose, double half_x, double half_y) {
  // Walls by their middle and a third of the way to the corner; inside free; outside never seen.
  for (const double side : {-1.0, 1.0}) {
    for (const double share : {-0.33, 0.0, 0.33}) {
      const auto at = [&](double x, double y) { return cell_at_point(map, transform(pose, {x, y})); };
      EXPECT_EQ(at(side * half_x, share * half_y), Cell::kOccupied)
          << "wall across x, side " << side << " share " << share;
      EXPECT_EQ(at(share * half_x, side * half_y), Cell::kOccupied)
          << "wall across y, side " << side << " share " << share;
      EXPECT_EQ(at(side * (half_x - 0.3), share * half_y), Cell::kFree);
      EXPECT_EQ(at(side * (half_x + 0.3), share * half_y), Cell::kUnknown);
      EXPECT_EQ(at(share * half_x, side * (half_y + 0.3)), Cell::kUnknown);
    }
  }
  EXPECT_EQ(cell_at_point(map, pose.translation()), Cell::kFree);
}

TEST(MapBuilderTest, ARoomLiesWhereItIs) {
  // Walls in the middle of their cells, so that rounding does not decide.
  const MapImage map = build(room(2.025, 1.025), {});
  expect_room(map, {}, 2.024, 1.024);
  EXPECT_TRUE(check_map_image(map).ok());
}

TEST(MapBuilderTest, PosesFarFromTheOriginAreAsExact) {
  for (const Pose2& pose : {Pose2{20'000.0, -20'000.0, 0.0}, Pose2{-20'000.0, 5.0, 0.0}, Pose2{1e5, 1e5, 0.0}}) {
    SCOPED_TRACE(pose.x);
    const MapImage map = build(room(2.025, 1.025), pose);
    expect_room(map, pose, 2.024, 1.024);
    EXPECT_LE(map.width, 2 * 63) << "only what is seen is held";
    EXPECT_LE(map.height, 2 * 43);
  }
}

TEST(MapBuilderTest, ATurnedScanLandsTurned) {
  const Pose2 pose{3.0, -2.0, std::numbers::pi / 2.0};
  expect_room(build(room(2.025, 1.025), pose), pose, 2.024, 1.024);
  // Any angle, by the share of the walls' points that lie in or next to an occupied cell.
  const Pose2 askew{-7.3, 4.1, 2.2};
  const MapImage map = build(room(2.0, 1.0), askew);
  int good = 0;
  int all = 0;
  for (double y = -0.9; y <= 0.9; y += 0.05) {
    bool hit = false;
    for (const double d : {-0.05, -0.025, 0.0, 0.025, 0.05}) {
      hit = hit || cell_at_point(map, transform(askew, {2.0 + d, y})) == Cell::kOccupied;
    }
    good += hit ? 1 : 0;
    ++all;
    EXPECT_EQ(cell_at_point(map, transform(askew, {1.7, y})), Cell::kFree);
  }
  EXPECT_EQ(good, all);
}

TEST(MapBuilderTest, TheSensorNeedNotSitAtTheBase) {
  Keyframe k = room(2.025, 1.025);
  k.geometry.base_from_sensor = {0.5, 0.0, std::numbers::pi / 2.0};
  const Pose2 pose{1.0, 1.0, 0.0};
  expect_room(build(k, pose), compose(pose, k.geometry.base_from_sensor), 2.024, 1.024);
}

TEST(MapBuilderTest, TwoScansShareOneMap) {
  const Keyframe small = room(1.025, 1.025);
  const Pose2 left{-10.0, 0.0, 0.0};
  const Pose2 right{30.0, 12.0, 0.0};
  MapBuilder builder(0.05, kPlenty, {}, kMaxBeams);
  for (const Pose2& pose : {left, right}) builder.extend(small, pose);
  builder.begin();
  for (int i = 0; i < 3; ++i) {
    for (const Pose2& pose : {left, right}) builder.insert(small, pose);
  }
  const MapImage map = builder.image();
  expect_room(map, left, 1.024, 1.024);
  expect_room(map, right, 1.024, 1.024);
  EXPECT_EQ(cell_at_point(map, {10.0, 5.0}), Cell::kUnknown);
}

TEST(MapBuilderTest, OneScanCountsOnceACellHoweverManyBeamsHitIt) {
  Keyframe k = room(0.225, 0.225);  // dozens of beams a cell
  const MapImage map = build(k, {}, 1);
  const int x = static_cast<int>(std::floor((0.224 - map.origin_x_m) / map.cell_m));
  const int y = static_cast<int>(std::floor((0.01 - map.origin_y_m) / map.cell_m));
  EXPECT_EQ(map.at(x, y), cell_of(occupancy_probability(1, 0, {})));
}

TEST(MapBuilderTest, ThousandsOfScansKeepCountsSane) {
  const Keyframe k = room(2.025, 1.025);
  const MapImage map = build(k, {}, 700);  // beyond the byte of a count, and of the scan's mark
  expect_room(map, {}, 2.024, 1.024);
}

TEST(MapBuilderTest, AMapThatDoesNotFitBecomesCoarser) {
  const Keyframe k = room(8.1, 8.1);
  MapBuilder builder(0.05, 200'000, {}, kMaxBeams);
  const Pose2 poses[] = {{0.0, 0.0, 0.0}, {40.0, 20.0, 0.0}};
  for (const Pose2& pose : poses) builder.extend(k, pose);
  builder.begin();
  for (int i = 0; i < 3; ++i) {
    for (const Pose2& pose : poses) builder.insert(k, pose);
  }
  EXPECT_LE(builder.bytes(), builder.bytes_limit());
  EXPECT_GT(4 * builder.bytes(), builder.bytes_limit() / 2) << "coarser than it needs to be";
  const MapImage map = builder.image();
  EXPECT_EQ(map.cell_m, 0.2);
  for (const Pose2& pose : poses) {
    EXPECT_EQ(cell_at_point(map, transform(pose, {8.1, 0.1})), Cell::kOccupied);
    EXPECT_EQ(cell_at_point(map, transform(pose, {0.1, -8.1})), Cell::kOccupied);
    EXPECT_EQ(cell_at_point(map, transform(pose, {4.0, 4.0})), Cell::kFree);
  }
  EXPECT_TRUE(check_map_image(map).ok());
}

TEST(MapBuilderTest, NothingInsertedIsASmallUnknownMap) {
  MapBuilder builder(0.05, kPlenty, {}, kMaxBeams);
  builder.begin();
  const MapImage map = builder.image();
  EXPECT_TRUE(check_map_image(map).ok());
  EXPECT_EQ(std::count(map.cells.begin(), map.cells.end(), std::uint8_t{0}),
            static_cast<std::ptrdiff_t>(map.cells.size()));
}

TEST(MapBuilderTest, AScanThatSawNothingAddsNothing) {
  Keyframe k = room(2.0, 1.0);
  std::fill(k.ranges_mm.begin(), k.ranges_mm.end(), kNoReturn_mm);
  const MapImage map = build(k, {5.0, 5.0, 1.0});
  EXPECT_TRUE(check_map_image(map).ok());
  EXPECT_EQ(std::count(map.cells.begin(), map.cells.end(), std::uint8_t{0}),
            static_cast<std::ptrdiff_t>(map.cells.size()));
  EXPECT_EQ(cell_at_point(map, {5.0, 5.0}), Cell::kUnknown) << "but it holds the cart's place";
}

}  // namespace
}  // namespace submapd
