// The branch and bound against trying everything, and the pyramid against its definition.
#include "slam/loop/internal/placement_search.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>

#include "slam/base/random.hpp"

namespace submapd::internal {
namespace {

constexpr double kCell_m = 0.05;

// A block of unknown ground with occupied cells strewn in lines and dots.
CellPlane random_plane(std::uint64_t seed) {
  CounterRandom random(seed, 0, 0);
  FinishedSubmap submap;
  OccupancyBlock block;
  block.bx = -1;
  for (int line = 0; line < 4; ++line) {
    const auto fixed = static_cast<int>(random.uniform(0.0, 64.0));
    const auto first = static_cast<int>(random.uniform(0.0, 40.0));
    const auto length = static_cast<int>(random.uniform(1.0, 24.0));
    const bool across = random.uniform() < 0.5;
    for (int i = first; i < first + length; ++i) {
      block.cells[static_cast<std::size_t>(across ? fixed * 64 + i : i * 64 + fixed)] = 255;
    }
  }
  submap.blocks.push_back(block);
  return *CellPlane::make(submap);
}

std::vector<Eigen::Vector2d> random_points(std::uint64_t seed) {
  CounterRandom random(seed, 1, 0);
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 40; ++i) {
    points.emplace_back(random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0));
  }
  return points;
}

std::uint8_t expected_score(const CellPlane& plane, int x, int y) {
  double best2 = 1e9;
  for (int cy = 0; cy < plane.height(); ++cy) {
    for (int cx = 0; cx < plane.width(); ++cx) {
      if (plane.kind(cx, cy) == CellKind::kOccupied) {
        best2 = std::min(best2, std::pow(cx - x, 2) + std::pow(cy - y, 2));
      }
    }
  }
  return static_cast<std::uint8_t>(std::lround(255.0 * std::exp(-best2 / (2.0 * 1.5 * 1.5))));
}

TEST(MatchGrid, LevelZeroIsTheScoreOfTheDistance) {
  const CellPlane plane = random_plane(3);
  const MatchGrid grid(plane, SurfaceIndex(FinishedSubmap{}, std::nullopt), 1);
  for (int y = -7; y < plane.height() + 7; ++y) {
    for (int x = -7; x < plane.width() + 7; ++x) {
      const int expected = expected_score(plane, x, y);
      // Beyond the kernel a score below one unit is dropped.
      ASSERT_NEAR(grid.value(0, x, y), expected, 1) << x << ", " << y;
    }
  }
}

TEST(MatchGrid, EveryLevelBoundsTheWindowItStandsFor) {
  const CellPlane plane = random_plane(4);
  const MatchGrid grid(plane, SurfaceIndex(FinishedSubmap{}, std::nullopt), kMaxPyramidLevel + 1);
  for (int level = 1; level < grid.levels(); ++level) {
    const int side = 1 << level;
    for (int y = -side - 9; y < plane.height() + 9; y += 3) {
      for (int x = -side - 9; x < plane.width() + 9; x += 3) {
        std::uint8_t largest = 0;
        for (int dy = 0; dy < side; ++dy) {
          for (int dx = 0; dx < side; ++dx) {
            largest = std::max(largest, grid.value(0, x + dx, y + dy));
          }
        }
        ASSERT_GE(grid.value(level, x, y), largest) << "level " << level << " at " << x << ", " << y;
        if (level <= 2) {
          ASSERT_EQ(grid.value(level, x, y), largest) << "level " << level << " at " << x << ", " << y;
        }
      }
    }
  }
}

// Score of every placement of the window, the best of those outside the zone.
std::int32_t exhaustive(const CellPlane& plane, const MatchGrid& grid, const std::vector<Eigen::Vector2d>& points,
                        const SearchWindow& window, const ExclusionZone* zone) {
  const auto half_x = static_cast<int>(std::ceil(window.half_x_m / kCell_m));
  const auto half_y = static_cast<int>(std::ceil(window.half_y_m / kCell_m));
  std::int32_t best = 0;
  for (const double yaw : window.yaws_rad) {
    const Eigen::Matrix2d turn = rotation(yaw);
    for (int oy = -half_y; oy <= half_y; ++oy) {
      for (int ox = -half_x; ox <= half_x; ++ox) {
        if (zone != nullptr && std::abs(wrap_angle(yaw - zone->centre.yaw)) <= zone->radius_rad &&
            std::hypot(window.centre.x + ox * kCell_m - zone->centre.x,
                       window.centre.y + oy * kCell_m - zone->centre.y) <= zone->radius_m) {
          continue;
        }
        std::int32_t score = 0;
        for (const Eigen::Vector2d& point : points) {
          const Eigen::Vector2d cell = (turn * point + (window.centre.translation() - plane.origin())) / kCell_m;
          score +=
              grid.value(0, static_cast<int>(std::floor(cell.x())) + ox, static_cast<int>(std::floor(cell.y())) + oy);
        }
        best = std::max(best, score);
      }
    }
  }
  return best;
}

RC_GTEST_PROP(PlacementSearch, FindsWhatTryingEverythingFinds, (std::uint64_t seed)) {
  const CellPlane plane = random_plane(seed);
  const int levels = 1 + static_cast<int>(seed % (kMaxPyramidLevel + 1));
  const MatchGrid grid(plane, SurfaceIndex(FinishedSubmap{}, std::nullopt), levels);
  const std::vector<Eigen::Vector2d> points = random_points(seed);
  CounterRandom random(seed, 2, 0);
  SearchWindow window;
  window.centre = {random.uniform(-3.0, 0.5), random.uniform(-1.0, 3.0), random.uniform(-3.0, 3.0)};
  window.half_x_m = random.uniform(0.2, 1.2);
  window.half_y_m = random.uniform(0.2, 1.2);
  window.yaws_rad = angle_steps(window.centre.yaw - 0.1, window.centre.yaw + 0.1, kCell_m, 2.0);
  const PlacementSearch search(plane, grid, points, window);

  const auto best = search.best(1, nullptr);
  RC_ASSERT((best ? best->score : 0) == exhaustive(plane, grid, points, window, nullptr));
  if (!best) {
    return;
  }
  const ExclusionZone zone{best->a_from_b, 0.31, 0.04};
  const auto second = search.best(1, &zone);
  RC_ASSERT((second ? second->score : 0) == exhaustive(plane, grid, points, window, &zone));
  if (second) {
    RC_ASSERT(!search.best(second->score + 1, &zone).has_value());
  }
}

TEST(AngleSteps, CoverTheWindowWithoutMovingFarPointsMoreThanACell) {
  const std::vector<double> angles = angle_steps(-0.3, 0.2, kCell_m, 12.0);
  EXPECT_DOUBLE_EQ(angles.front(), -0.3);
  EXPECT_DOUBLE_EQ(angles.back(), 0.2);
  for (std::size_t i = 1; i < angles.size(); ++i) {
    EXPECT_LE(12.0 * (angles[i] - angles[i - 1]), kCell_m * 1.001);
  }
}

}  // namespace
}  // namespace submapd::internal
