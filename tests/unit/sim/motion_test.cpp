// The cart keeps its limits, moves smoothly, stays clear of the walls, and starts and ends at rest.
#include "tools/sim/motion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tools/sim/office.hpp"
#include "tools/sim/tour_planner.hpp"

namespace submapd::tools {
namespace {

struct Extremes {
  double speed = 0.0;
  double along = 0.0;         // acceleration along the way, m/s^2
  double jerk = 0.0;          // along the way, m/s^3
  double lateral = 0.0;       // m/s^2
  double yaw_rate = 0.0;      // rad/s
  double yaw_rate_step = 0.0;  // largest change of the yaw rate within 2 ms, rad/s
  double velocity_step = 0.0;  // largest change of the velocity vector within 2 ms, m/s
};

// Central differences of the pose.
Extremes measure(const Motion& motion) {
  constexpr double kStep_s = 0.002;
  Extremes extremes;
  Pose2 last = motion.at(0.0);
  Eigen::Vector2d last_velocity = Eigen::Vector2d::Zero();
  double last_speed = 0.0;
  double last_yaw_rate = 0.0;
  std::vector<double> accelerations;
  for (double time_s = kStep_s; time_s <= motion.duration_s(); time_s += kStep_s) {
    const Pose2 pose = motion.at(time_s);
    const Eigen::Vector2d velocity = (pose.translation() - last.translation()) / kStep_s;
    const double speed = velocity.norm();
    const double yaw_rate = wrap_angle(pose.yaw - last.yaw) / kStep_s;
    const double along = (speed - last_speed) / kStep_s;
    accelerations.push_back(along);
    const double total = (velocity - last_velocity).norm() / kStep_s;
    extremes.speed = std::max(extremes.speed, speed);
    extremes.along = std::max(extremes.along, std::abs(along));
    extremes.lateral = std::max(extremes.lateral, std::sqrt(std::max(0.0, total * total - along * along)));
    extremes.yaw_rate = std::max(extremes.yaw_rate, std::abs(yaw_rate));
    extremes.yaw_rate_step = std::max(extremes.yaw_rate_step, std::abs(yaw_rate - last_yaw_rate));
    extremes.velocity_step = std::max(extremes.velocity_step, (velocity - last_velocity).norm());
    last = pose;
    last_velocity = velocity;
    last_speed = speed;
    last_yaw_rate = yaw_rate;
  }
  // Over 50 ms: shorter differences see the rounding of the third derivative.
  constexpr std::size_t kSpan = 25;
  for (std::size_t i = kSpan; i < accelerations.size(); ++i) {
    const double jerk = (accelerations[i] - accelerations[i - kSpan]) / (kSpan * kStep_s);
    extremes.jerk = std::max(extremes.jerk, std::abs(jerk));
  }
  return extremes;
}

class OfficeMotion : public testing::TestWithParam<double> {};

TEST_P(OfficeMotion, KeepsItsLimits) {
  MotionOptions options;
  options.speed_m_s = GetParam();
  const Expected<Motion> motion = Motion::along(office_tour(), options);
  ASSERT_TRUE(motion) << motion.error().message();
  const Extremes extremes = measure(*motion);
  EXPECT_LE(extremes.speed, options.speed_m_s);
  EXPECT_GT(extremes.speed, 0.9 * options.speed_m_s) << "slower than asked for";
  EXPECT_LE(extremes.along, 1.02 * options.acceleration_m_s2);
  EXPECT_LE(extremes.jerk, 1.05 * options.jerk_m_s3);
  EXPECT_LE(extremes.lateral, 1.05 * options.lateral_acceleration_m_s2);
  EXPECT_LE(extremes.yaw_rate, options.yaw_rate_rad_s);
  // No jump: within 2 ms velocity and yaw rate change by acceleration times time.
  EXPECT_LE(extremes.velocity_step, 0.002 * 2.0);
  EXPECT_LE(extremes.yaw_rate_step, 0.002 * 8.0);
}

INSTANTIATE_TEST_SUITE_P(Speeds, OfficeMotion, testing::Values(0.5, 1.5, 2.9));

TEST(Motion, StaysClearOfTheOfficesWallsForAnySeed) {
  const World world = office_world();
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U, 99U}) {
    MotionOptions options;
    options.seed = seed;
    const Expected<Motion> motion = Motion::along(office_tour(), options);
    ASSERT_TRUE(motion);
    EXPECT_GE(min_clearance(world, *motion, 1.0), 0.3) << "seed " << seed;
  }
}

TEST(Motion, StandsAtStartAndEndAndFillsTheTimeAskedFor) {
  for (const double duration_s : {6.0, 17.3, 60.0, 600.0}) {
    MotionOptions options;
    options.duration_s = duration_s;
    const Expected<Motion> motion = Motion::along(office_tour(), options);
    ASSERT_TRUE(motion) << motion.error().message();
    EXPECT_EQ(motion->duration_s(), duration_s);
    EXPECT_EQ(motion->at(0.0), motion->at(0.999));
    EXPECT_EQ(motion->at(duration_s - 0.999), motion->at(duration_s));
    EXPECT_GT(motion->length_m(), 0.3);
    // Whatever is left at the end is shorter than a turn and a short leg.
    EXPECT_FALSE(motion->at(duration_s - 6.0) == motion->at(duration_s)) << duration_s;
  }
}

TEST(Motion, LengthIsTheIntegralOfSpeed) {
  const Expected<Motion> motion = Motion::along(office_tour(), {});
  ASSERT_TRUE(motion);
  double driven_m = 0.0;
  for (double time_s = 0.0; time_s < motion->duration_s(); time_s += 0.005) {
    driven_m += (motion->at(time_s + 0.005).translation() - motion->at(time_s).translation()).norm();
  }
  EXPECT_NEAR(driven_m, motion->length_m(), 0.002 * motion->length_m());
}

TEST(Motion, HeadsAlongThePathUpToTheWobble) {
  MotionOptions options;
  const Expected<Motion> motion = Motion::along(office_tour(), options);
  ASSERT_TRUE(motion);
  double largest = 0.0;
  for (double time_s = 0.0; time_s < motion->duration_s(); time_s += 0.01) {
    const Eigen::Vector2d moved = motion->at(time_s + 1e-3).translation() - motion->at(time_s - 1e-3).translation();
    if (moved.norm() > 2e-4) {
      largest = std::max(largest, std::abs(wrap_angle(std::atan2(moved.y(), moved.x()) - motion->at(time_s).yaw)));
    }
  }
  EXPECT_LE(largest, options.wobble_rad + 1e-4);
  EXPECT_GE(largest, 0.3 * options.wobble_rad);
}

TEST(Motion, TurnsOnTheSpotWhereTheWayReverses) {
  Route route;
  route.waypoints = {{0.0, 0.0}, {5.0, 0.0}, {0.0, 0.0}};
  const Expected<Motion> motion = Motion::along(route, {});
  ASSERT_TRUE(motion);
  EXPECT_NEAR(motion->length_m(), 10.0, 1e-6);
  double turned_rad = 0.0;
  for (double time_s = 0.0; time_s < motion->duration_s(); time_s += 0.01) {
    const Pose2 before = motion->at(time_s);
    const Pose2 after = motion->at(time_s + 0.01);
    const double turn = std::abs(wrap_angle(after.yaw - before.yaw));
    if (before.translation() == after.translation()) {
      turned_rad += turn;
    }
    EXPECT_NEAR(before.y, 0.0, 1e-9);
  }
  EXPECT_NEAR(turned_rad, std::numbers::pi, 0.01);
}

TEST(Motion, RefusesWhatCannotBeDriven) {
  Route route;
  EXPECT_EQ(Motion::along(route, {}).error().code(), StatusCode::kInvalidArgument);
  route.waypoints = {{1.0, 1.0}};
  EXPECT_FALSE(Motion::along(route, {}));
  route.waypoints = {{1.0, 1.0}, {1.0, 1.0}};
  MotionOptions minute;
  minute.duration_s = 60.0;
  EXPECT_FALSE(Motion::along(route, {}));
  EXPECT_FALSE(Motion::along(route, minute));
  route.closed = true;
  EXPECT_FALSE(Motion::along(route, minute));
  route.waypoints = {{1.0, 1.0}, {3.0, 1.0}};
  MotionOptions options;
  options.speed_m_s = 0.0;
  EXPECT_FALSE(Motion::along(route, options));
  options = {};
  options.duration_s = 1.5;
  EXPECT_FALSE(Motion::along(route, options)) << "too short to move";
}

}  // namespace
}  // namespace submapd::tools
