// Outlines: known area, extent, normals, and the overlap they predict.
#include "slam/loop/submap_outline.hpp"

#include <gtest/gtest.h>

#include <numeric>

#include "slam/base/random.hpp"
#include "tests/unit/loop/synthetic_submap.hpp"

namespace submapd::testing {
namespace {

FinishedSubmap known_square(std::int32_t bx, std::int32_t by) {
  FinishedSubmap submap;
  OccupancyBlock block;
  block.bx = bx;
  block.by = by;
  block.cells.fill(cell_of(0.1));
  submap.blocks.push_back(block);
  return submap;
}

TEST(SubmapOutline, HoldsAreaCentreAndRadiusOfABlock) {
  const SubmapOutline outline = make_outline(known_square(-1, 0));
  EXPECT_NEAR(outline.known_area_m2(), 3.2 * 3.2, 1.5);
  EXPECT_NEAR(outline.centre.x(), -1.6, 0.2);
  EXPECT_NEAR(outline.centre.y(), 1.6, 0.2);
  EXPECT_GT(outline.radius_m, 1.6);
  EXPECT_LT(outline.radius_m, 2.6);
}

TEST(SubmapOutline, OverlapOfAnEmptyOneIsNothing) {
  const SubmapOutline square = make_outline(known_square(0, 0));
  EXPECT_EQ(overlap_m2(square, SubmapOutline{}, Pose2{}, 1.0), 0.0);
  EXPECT_EQ(overlap_m2(SubmapOutline{}, square, Pose2{}, 1.0), 0.0);
}

// Against each cell of b asked whether any of a's is near enough.
TEST(SubmapOutline, OverlapIsWhatItsDefinitionCounts) {
  const SubmapOutline a = make_outline(known_square(0, 0));
  const SubmapOutline b = make_outline(known_square(-2, 1));
  for (std::uint64_t trial = 0; trial < 200; ++trial) {
    CounterRandom random(1, trial, 0);
    const Pose2 pose{random.uniform(-8.0, 12.0), random.uniform(-8.0, 8.0), random.uniform(-3.0, 3.0)};
    const double grow = trial % 4 == 0 ? 0.0 : random.uniform(0.0, 4.0);
    std::size_t expected = 0;
    for (const auto& cell : b.known) {
      const Eigen::Vector2d place =
          transform(pose, Eigen::Vector2d(0.5 * (cell[0] + 0.5), 0.5 * (cell[1] + 0.5))) / 0.5;
      bool near = false;
      for (const auto& own : a.known) {
        near = near || std::hypot(std::floor(place.x()) - own[0], std::floor(place.y()) - own[1]) <= grow / 0.5 + 1e-9;
      }
      expected += near ? 1 : 0;
    }
    ASSERT_DOUBLE_EQ(overlap_m2(a, b, pose, grow), 0.25 * static_cast<double>(expected)) << "trial " << trial;
  }
}

TEST(SubmapOutline, NormalsOfARoomPointInwardsAlongItsAxes) {
  World world;
  world.box(0.0, 0.0, 8.0, 4.0);
  const FinishedSubmap room = make_submap(world, walk({{2.0, 2.0}, {6.0, 2.0}, {2.0, 2.0}}, 0.5, 0), {});
  const SubmapOutline outline = make_outline(room);
  const auto& bins = outline.normal_histogram;
  EXPECT_NEAR(std::accumulate(bins.begin(), bins.end(), 0.0), 1.0, 1e-5);
  double near_axes = 0.0;
  for (int i = 0; i < 360; ++i) {
    near_axes += (i % 90 <= 5 || i % 90 >= 85) ? static_cast<double>(bins[static_cast<std::size_t>(i)]) : 0.0;
  }
  EXPECT_GT(near_axes, 0.9);
}

}  // namespace
}  // namespace submapd::testing
