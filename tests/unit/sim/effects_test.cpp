// What makes simulated runs hard has the size it says: glass, mirrors, people, tilt, edges, bias, clock, lost scans.
#include "tools/sim/effects.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tools/sim/beam.hpp"
#include "tools/sim/floor.hpp"

namespace submapd::tools {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

std::shared_ptr<const Motion> along_x(double duration_s, const MotionOptions& basis = {}) {
  Route route;
  route.waypoints = {{0.0, 0.0}, {40.0, 0.0}};
  MotionOptions options = basis;
  options.duration_s = duration_s;
  return std::make_shared<const Motion>(*Motion::along(route, options));
}

// The first scans of a cart that stands for a second.
std::vector<Scan> record(const World& world, const SimulatorOptions& options, std::size_t count) {
  Simulator simulator(std::make_shared<const World>(world), along_x(60.0), options);
  std::vector<Scan> scans;
  while (scans.size() < count) {
    scans.push_back(*simulator.next());
  }
  return scans;
}

// A pane at x = 2 before a wall at x = 5.
TEST(Beam, GlassAnswersNearItsNormalOnlyElseTheBeamGoesOnOrIsReflected) {
  const World world({{{2.0, -50.0}, {2.0, 50.0}, Surface::kGlass}, {{5.0, -50.0}, {5.0, 50.0}}});
  int through = 0;
  int reflected = 0;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    CounterRandom random(1, 2, i);
    const auto at = [&](double degrees) {
      return trace(world, {}, 0.0, {0.0, 0.0}, {std::cos(degrees * kDegree), std::sin(degrees * kDegree)}, 30.0,
                   random);
    };
    EXPECT_NEAR(at(3.0)->range_m, 2.0 / std::cos(3.0 * kDegree), 1e-6);
    const auto oblique = at(60.0);
    through += oblique && std::abs(oblique->range_m - 10.0) < 1e-3 ? 1 : 0;
    reflected += oblique ? 0 : 1;  // nothing behind the cart
  }
  EXPECT_NEAR(reflected, 2000 * (0.08 + 0.92 / 32.0), 60);
  EXPECT_EQ(through + reflected, 2000);
}

TEST(Beam, MirrorShowsWhatIsBeforeItBehindIt) {
  const World world({{{2.0, -50.0}, {2.0, 50.0}, Surface::kMirror}, {{-3.0, -50.0}, {-3.0, 50.0}}});
  CounterRandom random(1, 2, 3);
  const double yaw_rad = 20.0 * kDegree;
  const auto echo = trace(world, {}, 0.0, {0.0, 0.0}, {std::cos(yaw_rad), std::sin(yaw_rad)}, 30.0, random);
  ASSERT_TRUE(echo);
  EXPECT_NEAR(echo->range_m, (2.0 + 5.0) / std::cos(yaw_rad), 1e-4);
}

TEST(Crowd, PeopleMoveAlongTheirWayAndKeepOffTheCart) {
  const Crowd crowd({{{{0.0, 0.0}, {20.0, 0.0}}, 1.0}}, 40, 5);
  std::vector<Disc> before;
  std::vector<Disc> after;
  const Eigen::Vector2d cart(10.0, 0.0);
  double farthest_m = 0.0;
  for (double time_s = 0.0; time_s < 60.0; time_s += 1.0) {
    crowd.near(time_s, cart, 30.0, before);
    crowd.near(time_s + 0.02, cart, 30.0, after);
    ASSERT_EQ(before.size(), 40U);
    for (std::size_t i = 0; i < before.size(); ++i) {
      EXPECT_GE((before[i].centre - cart).norm(), 0.84);
      EXPECT_LE(std::abs(before[i].centre.y()), 1.6);
      if ((before[i].centre - cart).norm() > 1.0) {
        EXPECT_LT((before[i].centre + 0.02 * before[i].velocity - after[i].centre).norm(), 1e-3);
      }
      farthest_m = std::max(farthest_m, before[i].velocity.norm());
    }
  }
  EXPECT_GT(farthest_m, 1.0) << "somebody walks";
}

TEST(Crowd, CompanionsStayWithTheCart) {
  const auto motion = along_x(25.0);
  Crowd crowd({}, 0, 1);
  crowd.accompany(*motion, 6, 1);
  std::vector<Disc> seen;
  for (double time_s = 0.0; time_s < 25.0; time_s += 0.5) {
    crowd.near(time_s, motion->at(time_s).translation(), 8.0, seen);
    EXPECT_EQ(seen.size(), 6U) << time_s;
  }
}

TEST(Floor, ScanPlaneMeetsTheRampAheadOfItsFoot) {
  const Floor floor({{10.0, 0.0}, {30.0, 1.2}});
  // 0.8 m above a floor that begins to rise by 6 % at x = 10.
  EXPECT_NEAR(*floor.meet({4.0, 0.0}, {1.0, 0.0}, 0.0, 30.0), 6.0 + 0.8 / 0.06, 1e-9);
  EXPECT_FALSE(floor.meet({4.0, 0.0}, {-1.0, 0.0}, 0.0, 30.0));
  // On the ramp the plane is the ramp's: ahead nothing is met before its top, but sideways it stays level.
  const Eigen::Vector3d ahead = floor.beam({20.0, 0.0, 0.0}, 0.0);
  EXPECT_NEAR(ahead.z() / ahead.x(), 0.06, 1e-9);
  EXPECT_NEAR(floor.beam({20.0, 0.0, 0.0}, 90.0 * kDegree).z(), 0.0, 1e-9);
  // Across it the cart rolls.
  EXPECT_NEAR(floor.beam({20.0, 0.0, 90.0 * kDegree}, -90.0 * kDegree).z(), 0.06, 1e-3);
}

TEST(Effects, AreAskedForByName) {
  EXPECT_EQ(*parse_effects("none"), Effects{});
  EXPECT_EQ(*parse_effects("lost,mixed"), (Effects{.mixed = true, .lost = true}));
  EXPECT_TRUE(parse_effects("all")->jerky);
  const auto unknown = parse_effects("mixed,fog");
  ASSERT_FALSE(unknown);
  EXPECT_THAT(unknown.error().message(), testing::AllOf(testing::HasSubstr("fog"), testing::HasSubstr("clock")));
}

// An edge: a near wall up to the beam straight ahead, a wall 0.6 m farther from there on.
TEST(Effects, MixedPixelsLieBetweenBothSidesOfAnEdge) {
  const World world({{{3.0, -50.0}, {3.0, 0.0}}, {{3.6, 0.0}, {3.6, 50.0}}});
  SimulatorOptions options;
  apply(Effects{.mixed = true}, options.sensor);
  options.sensor.sigma_near_m = 0.001;
  int between = 0;
  constexpr int kScans = 40;
  for (const Scan& scan : record(world, options, kScans)) {
    for (int i = 530; i <= 551; ++i) {
      const double range_m = 1e-3 * scan.ranges_mm[static_cast<std::size_t>(i)];
      const bool mixed = range_m > 3.02 && range_m < 3.58;
      EXPECT_FALSE(mixed && (i < 539 || i > 541)) << "beam " << i;
      between += mixed ? 1 : 0;
    }
  }
  EXPECT_NEAR(between, 2 * 0.3 * kScans, 0.3 * kScans);
}

TEST(Effects, BiasStaysWithinTwentyMillimetresAndDependsOnTheRange) {
  double least_m = 1.0;
  double most_m = -1.0;
  for (const double distance_m : {2.0, 3.5, 5.0, 6.5}) {
    const World world({{{distance_m, -100.0}, {distance_m, 100.0}}});
    SimulatorOptions options;
    apply(Effects{.bias = true}, options.sensor);
    options.sensor.sigma_near_m = 0.0;
    const std::vector<Scan> scans = record(world, options, 1);
    for (int i = 200; i <= 880; ++i) {
      const double angle_rad = (i - 540) * 0.25 * kDegree;
      const double exact_m = distance_m / std::cos(angle_rad);
      const std::uint16_t range_mm = scans[0].ranges_mm[static_cast<std::size_t>(i)];
      if (exact_m < 10.0 && range_mm > 0) {
        least_m = std::min(least_m, 1e-3 * range_mm - exact_m);
        most_m = std::max(most_m, 1e-3 * range_mm - exact_m);
      }
    }
  }
  EXPECT_LE(most_m, 0.021);
  EXPECT_GE(least_m, -0.021);
  EXPECT_GT(most_m - least_m, 0.012);
}

TEST(Effects, ClockDriftsInWholeMillisecondsWhileTruthKeepsTheScansInstant) {
  const World world({{{50.0, -100.0}, {50.0, 100.0}}});
  SimulatorOptions options;
  options.seed = 2;
  apply(Effects{.clock = true, .lost = true}, options.sensor);
  options.sensor.beams = 2;
  const auto motion = along_x(120.0);
  Simulator simulator(std::make_shared<const World>(world), motion, options);
  std::int64_t last_us = 0;
  std::uint64_t told = 0;
  std::uint64_t longest_gap = 0;
  std::optional<std::uint64_t> last_index;
  double drift_us = 0.0;
  while (const auto scan = simulator.next()) {
    EXPECT_EQ(scan->stamp_us % 1000, 0);
    EXPECT_GT(scan->stamp_us, last_us);
    const double true_s = 0.025 * static_cast<double>(scan->index);
    EXPECT_LT((simulator.truth(*scan).translation() - motion->at(true_s).translation()).norm(), 1e-9);
    drift_us = static_cast<double>(scan->stamp_us - options.start_stamp_us) - 1e6 * true_s;
    longest_gap = std::max(longest_gap, last_index ? scan->index - *last_index : 0);
    last_us = scan->stamp_us;
    last_index = scan->index;
    ++told;
  }
  EXPECT_LE(std::abs(drift_us), 120.0 * 100.0 + 1000.0);
  EXPECT_GT(std::abs(drift_us), 1500.0);
  EXPECT_LT(told, simulator.scan_count());
  EXPECT_GT(told, simulator.scan_count() * 95 / 100);
  EXPECT_GT(longest_gap, 2U);
}

TEST(Effects, JerkyPushingStopsLooksRoundAndStaysOnItsWay) {
  MotionOptions options;
  options.speed_m_s = 3.0;
  apply(Effects{.jerky = true}, options);
  const auto jerky = along_x(200.0, options);
  double still_s = 0.0;
  double most_yaw_rad = 0.0;
  for (double t = 2.0; t < 190.0; t += 0.05) {
    const Pose2 pose = jerky->at(t);
    EXPECT_LE(std::abs(pose.y), 0.01);
    const bool inside = pose.x > 1.0 && pose.x < 39.0;
    still_s += inside && (jerky->at(t + 0.05).translation() - pose.translation()).norm() < 1e-4 ? 0.05 : 0.0;
    most_yaw_rad = std::max(most_yaw_rad, inside ? std::abs(std::sin(pose.yaw)) : 0.0);
  }
  EXPECT_GT(still_s, 3.0);
  EXPECT_GT(most_yaw_rad, 0.5) << "at some stop the cart looks round";
}

TEST(Effects, StepsRippleTheSpeedByTheirShare) {
  MotionOptions options;
  options.speed_m_s = 2.0;
  options.cadence_ripple = 0.03;
  const auto motion = along_x(0.0, options);
  double least_m_s = 10.0;
  double most_m_s = 0.0;
  for (double t = 8.0; t < 14.0; t += 0.01) {
    const double speed_m_s = (motion->at(t + 0.01).x - motion->at(t).x) / 0.01;
    least_m_s = std::min(least_m_s, speed_m_s);
    most_m_s = std::max(most_m_s, speed_m_s);
  }
  EXPECT_NEAR((most_m_s - least_m_s) / (most_m_s + least_m_s), 0.03, 0.002);
}

}  // namespace
}  // namespace submapd::tools
