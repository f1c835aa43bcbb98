// The grid's ray casting against closed forms and against all walls tried in turn.
#include "tools/sim/world.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"
#include "tools/sim/office.hpp"

namespace submapd::tools {
namespace {

Eigen::Vector2d direction(double yaw_rad) {
  return {std::cos(yaw_rad), std::sin(yaw_rad)};
}

std::optional<double> brute_force(const World& world, const Eigen::Vector2d& origin, const Eigen::Vector2d& along,
                                  double range_max_m) {
  std::optional<double> nearest;
  for (const Segment& segment : world.segments()) {
    const std::optional<double> t = intersect(origin, along, segment);
    if (t && *t <= range_max_m && (!nearest || *t < *nearest)) {
      nearest = t;
    }
  }
  return nearest;
}

void expect_same(const World& world, const Eigen::Vector2d& origin, double yaw_rad, double range_max_m) {
  const std::optional<double> expected = brute_force(world, origin, direction(yaw_rad), range_max_m);
  const std::optional<RayHit> hit = world.cast(origin, direction(yaw_rad), range_max_m);
  ASSERT_EQ(hit.has_value(), expected.has_value()) << origin.transpose() << " yaw " << yaw_rad;
  if (hit) {
    ASSERT_EQ(hit->range_m, *expected) << origin.transpose() << " yaw " << yaw_rad;
  }
}

TEST(World, WallAtKnownDistanceAndIncidence) {
  const World world({{{3.0, -10.0}, {3.0, 10.0}}});
  for (const double yaw : {0.0, 0.3, -0.9, 1.2}) {
    const std::optional<RayHit> hit = world.cast({0.5, 0.2}, direction(yaw), 30.0);
    ASSERT_TRUE(hit);
    EXPECT_NEAR(hit->range_m, 2.5 / std::cos(yaw), 1e-12);
    EXPECT_NEAR(hit->cos_incidence, std::cos(yaw), 1e-12);
    EXPECT_EQ(hit->segment, 0U);
  }
  EXPECT_FALSE(world.cast({0.5, 0.2}, direction(3.0), 30.0));
  EXPECT_FALSE(world.cast({0.5, 0.2}, direction(0.0), 2.4));
}

TEST(World, CircleFromItsCentre) {
  std::vector<Segment> walls;
  constexpr int kCorners = 720;
  const auto corner = [](int i) -> Eigen::Vector2d {
    return 7.0 * direction(2.0 * std::numbers::pi * (i % kCorners) / kCorners);
  };
  for (int i = 0; i < kCorners; ++i) {
    walls.push_back({corner(i), corner(i + 1)});
  }
  const World world(std::move(walls));
  for (int i = 0; i < 1000; ++i) {
    const std::optional<RayHit> hit = world.cast({0.0, 0.0}, direction(0.0123 * i), 30.0);
    ASSERT_TRUE(hit);
    EXPECT_LE(hit->range_m, 7.0 + 1e-12);
    EXPECT_GE(hit->range_m, 7.0 * std::cos(std::numbers::pi / kCorners) - 1e-12);
  }
}

TEST(World, NoGapWhereWallsShareACorner) {
  const World world({{{1.0, -1.0}, {2.0, 0.0}}, {{2.0, 0.0}, {1.0, 1.0}}});
  const std::optional<RayHit> hit = world.cast({0.0, 0.0}, {1.0, 0.0}, 30.0);
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->range_m, 2.0, 1e-12);
}

TEST(World, EmptyAndOnePointWorldsAreNeverHit) {
  EXPECT_FALSE(World({}).cast({0.0, 0.0}, {1.0, 0.0}, 30.0));
  EXPECT_EQ(World({}).clearance({0.0, 0.0}, 2.0), 2.0);
  const World point({{{1.0, 0.0}, {1.0, 0.0}}});
  EXPECT_FALSE(point.cast({0.0, 0.0}, {1.0, 0.0}, 30.0));
  EXPECT_NEAR(point.clearance({0.0, 0.0}, 2.0), 1.0, 1e-12);
}

TEST(World, OfficeAsBruteForce) {
  const World world = office_world();
  CounterRandom random(1, 2, 3);
  for (int i = 0; i < 2000; ++i) {
    // Also from outside.
    const Eigen::Vector2d origin(random.uniform(-5.0, 45.0), random.uniform(-5.0, 30.0));
    expect_same(world, origin, random.uniform(-4.0, 4.0), 30.0);
  }
}

TEST(World, AxisAlignedRaysAlongCellBordersAsBruteForce) {
  std::vector<Segment> walls;
  for (int i = 0; i < 20; ++i) {
    walls.push_back({{1.0 * i, 0.0}, {1.0 * i, 20.0 - i}});
    walls.push_back({{0.0, 1.0 * i}, {20.0 - i, 1.0 * i}});
  }
  const World world(std::move(walls));
  for (int x = 0; x < 40; ++x) {
    for (int y = 0; y < 40; ++y) {
      for (int quarter = 0; quarter < 4; ++quarter) {
        const Eigen::Vector2d along[] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
        const Eigen::Vector2d origin(0.5 * x, 0.5 * y);
        const std::optional<RayHit> hit = world.cast(origin, along[quarter], 30.0);
        const std::optional<double> expected = brute_force(world, origin, along[quarter], 30.0);
        ASSERT_EQ(hit.has_value(), expected.has_value()) << origin.transpose() << " quarter " << quarter;
        ASSERT_TRUE(!hit || hit->range_m == *expected);
      }
    }
  }
}

TEST(World, RandomWallsAsBruteForce) {
  const bool holds = rc::check("cast and clearance", [](std::uint32_t seed) {
    CounterRandom random(seed, 0, 0);
    const int count = 1 + static_cast<int>(random.uniform(0.0, 60.0));
    const double size = std::pow(10.0, random.uniform(-1.0, 2.5));
    const auto point = [&]() -> Eigen::Vector2d {
      const double x = random.uniform(-size, size);
      return {x, random.uniform(-size, size)};
    };
    std::vector<Segment> walls;
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector2d a = point();
      walls.push_back({a, random.uniform() < 0.5 ? point() : Eigen::Vector2d(a + 0.1 * point())});
    }
    const World world(walls);
    for (int i = 0; i < 50; ++i) {
      const Eigen::Vector2d origin = 1.2 * point();
      const Eigen::Vector2d along = direction(random.uniform(-4.0, 4.0));
      const std::optional<double> expected = brute_force(world, origin, along, size);
      const std::optional<RayHit> hit = world.cast(origin, along, size);
      RC_ASSERT(hit.has_value() == expected.has_value());
      if (hit) {  // RC_ASSERT evaluates both sides of ||
        RC_ASSERT(hit->range_m == *expected);
      }
      double nearest = size;
      for (const Segment& wall : walls) {
        nearest = std::min(nearest, distance_to(wall, origin));
      }
      RC_ASSERT(std::abs(world.clearance(origin, size) - nearest) < 1e-12);
    }
  });
  EXPECT_TRUE(holds);
}

}  // namespace
}  // namespace submapd::tools
