// Built-in worlds are what their names say, the same for the same seed, and their tours keep clear of walls.
#include "tools/sim/worlds/worlds.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tools/sim/scene.hpp"
#include "tools/sim/tour_planner.hpp"

namespace submapd::tools {
namespace {

Motion drive(const Site& site, const Effects& effects, std::uint64_t seed) {
  MotionOptions options;
  options.seed = seed;
  options.speed_m_s = 3.0;
  apply(effects, options);
  return *Motion::along(site.route, options);
}

double range_m(const World& world, const Eigen::Vector2d& from, double yaw_rad) {
  const auto hit = world.cast(from, {std::cos(yaw_rad), std::sin(yaw_rad)}, 30.0);
  return hit ? hit->range_m : 30.0;
}

// Share of 720 beams from two places that reach equally far.
double alike(const World& world, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  int same = 0;
  for (int i = 0; i < 720; ++i) {
    const double yaw_rad = std::numbers::pi * (i + 0.5) / 360.0;
    same += std::abs(range_m(world, a, yaw_rad) - range_m(world, b, yaw_rad)) < 1e-3 ? 1 : 0;
  }
  return same / 720.0;
}

class EachWorld : public testing::TestWithParam<BuiltInWorld> {};

TEST_P(EachWorld, TourKeepsClearOfWallsAndOfMovedFurniture) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const Site site = GetParam().build(seed);
    const Motion motion = drive(site, {}, seed);
    EXPECT_GE(min_clearance(World(site.walls), motion, 1.0), 0.3) << "seed " << seed;
    EXPECT_GE(min_clearance(World(move_furniture(site.walls, site.furniture, seed)), motion, 1.0), 0.25)
        << "seed " << seed;
  }
}

TEST_P(EachWorld, IsMadeByItsSeedAlone) {
  const Site a = GetParam().build(7);
  const Site b = GetParam().build(7);
  ASSERT_EQ(a.walls.size(), b.walls.size());
  for (std::size_t i = 0; i < a.walls.size(); ++i) {
    ASSERT_TRUE(a.walls[i].a == b.walls[i].a && a.walls[i].b == b.walls[i].b) << i;
  }
  EXPECT_EQ(a.route.waypoints, b.route.waypoints);
}

INSTANTIATE_TEST_SUITE_P(BuiltIn, EachWorld, testing::ValuesIn(built_in_worlds().begin(), built_in_worlds().end()),
                         [](const auto& world) { return std::string(world.param.name); });

TEST(Worlds, OtherSeedsFurnishOtherwise) {
  EXPECT_NE(build_mall(1).walls.size(), build_mall(2).walls.size());
  EXPECT_NE(build_street(1).walls.size(), build_street(2).walls.size());
}

TEST(Worlds, MallIsLargeAndItsTourLongAndOfGlass) {
  const Site mall = build_mall(1);
  const World world(mall.walls);
  const Eigen::Vector2d extent = world.high() - world.low();
  EXPECT_GE(extent.x() * extent.y(), 12'000.0);
  EXPECT_GE(drive(mall, {}, 1).length_m(), 1'500.0);
  double glass_m = 0.0;
  int mirrors = 0;
  for (const Segment& wall : mall.walls) {
    glass_m += wall.surface == Surface::kGlass ? (wall.b - wall.a).norm() : 0.0;
    mirrors += wall.surface == Surface::kMirror ? 1 : 0;
  }
  EXPECT_GE(glass_m, 150.0);
  EXPECT_GE(mirrors, 3);
  EXPECT_GE(mall.people, 200);
}

TEST(Worlds, StreetIsOpenToTheSkyOnOneSideOnly) {
  const World street(build_street(1).walls);
  int open_side = 0;
  int houses = 0;
  for (double x = 10.0; x < 141.0; x += 10.0) {
    for (int degrees = 30; degrees <= 150; ++degrees) {
      const double yaw_rad = degrees * std::numbers::pi / 180.0;
      open_side += range_m(street, {x, 7.0}, yaw_rad) < 30.0 ? 1 : 0;
      houses += range_m(street, {x, 7.0}, -yaw_rad) < 30.0 ? 1 : 0;
    }
  }
  EXPECT_LT(open_side, 0.35 * 14 * 121);
  EXPECT_GT(houses, 0.95 * 14 * 121);
}

TEST(Worlds, TwinsLookAlike) {
  const World wings(build_twin_wings(1).walls);
  const double share = alike(wings, {10.0, 22.0}, {46.0, 22.0});
  EXPECT_GT(share, 0.85);
  EXPECT_LT(share, 1.0) << "the wings must be told apart by something";
  const World floors(build_identical_floors(1).walls);
  EXPECT_EQ(alike(floors, {16.0, 5.9}, {60.0, 5.9}), 1.0);
}

TEST(Worlds, CorridorIsBlankForLongerThanTheScannerSees) {
  const World corridor(build_corridor(1).walls);
  for (const double x : {40.0, 100.0, 160.0}) {
    for (int i = 0; i < 360; ++i) {
      const double yaw_rad = std::numbers::pi * (i + 0.5) / 180.0;
      EXPECT_NEAR(range_m(corridor, {x, 0.0}, yaw_rad), std::min(30.0, 1.2 / std::abs(std::sin(yaw_rad))), 1e-6);
    }
  }
  const auto slowest = [](const Site& site) {
    const Motion motion = drive(site, {}, 1);
    double slowest_m_s = 10.0;
    for (double t = 0.0; t < motion.duration_s(); t += 0.05) {
      const double x = motion.at(t).x;
      if (x > 20.0 && x < 180.0) {
        slowest_m_s = std::min(slowest_m_s, (motion.at(t + 0.05).x - x) / 0.05);
      }
    }
    return slowest_m_s;
  };
  EXPECT_GT(slowest(build_corridor(1)), 2.9);
  EXPECT_LT(slowest(build_corridor_braking(1)), 0.5);
}

TEST(Scene, UnknownWorldsAreRefusedByNamingTheKnownOnes) {
  SceneRequest request;
  request.world = "mal";
  const auto scene = make_scene(request);
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message(), testing::AllOf(testing::HasSubstr("mal:"), testing::HasSubstr("mall"),
                                                      testing::HasSubstr("twin_wings"), testing::HasSubstr(".csv")));
}

TEST(Scene, MovedFurnitureIsFewAndNear) {
  const Site site = build_mall(1);
  const std::vector<Segment> later = move_furniture(site.walls, site.furniture, 1);
  EXPECT_LT(later.size(), site.walls.size());
  EXPECT_GT(later.size(), site.walls.size() - site.walls.size() / 5);
  EXPECT_EQ(later.back().a, site.walls.back().a) << "what is no furniture stays";
}

}  // namespace
}  // namespace submapd::tools
