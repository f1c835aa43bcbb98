#include "slam/base/pose2.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace submapd {
namespace {

constexpr double kPi = std::numbers::pi;

// A number of [-range, range] in steps of 1e-9 of it.
double any_within(double range) {
  return range * *rc::gen::inRange(-1'000'000'000, 1'000'000'001) * 1e-9;
}
Pose2 any_pose() {
  return {any_within(100.0), any_within(100.0), any_within(10.0)};
}

double distance(const Pose2& a, const Pose2& b) {
  return std::max({std::abs(a.x - b.x), std::abs(a.y - b.y), std::abs(wrap_angle(a.yaw - b.yaw))});
}

RC_GTEST_PROP(Pose2Test, InverseUndoesBothWays, ()) {
  const Pose2 a = any_pose();
  RC_ASSERT(distance(compose(a, inverse(a)), Pose2{}) < 1e-12);
  RC_ASSERT(distance(compose(inverse(a), a), Pose2{}) < 1e-12);
  RC_ASSERT(distance(inverse(inverse(a)), a) < 1e-12);
}

RC_GTEST_PROP(Pose2Test, ComposeIsAssociativeWithTheIdentity, ()) {
  const Pose2 a = any_pose();
  const Pose2 b = any_pose();
  const Pose2 c = any_pose();
  RC_ASSERT(distance(compose(compose(a, b), c), compose(a, compose(b, c))) < 1e-11);
  RC_ASSERT(distance(compose(a, Pose2{}), a) < 1e-15);
  RC_ASSERT(distance(compose(Pose2{}, a), a) < 1e-15);
}

RC_GTEST_PROP(Pose2Test, BetweenIsInverseThenCompose, ()) {
  const Pose2 a = any_pose();
  const Pose2 b = any_pose();
  RC_ASSERT(distance(between(a, b), compose(inverse(a), b)) < 1e-11);
  RC_ASSERT(distance(compose(a, between(a, b)), b) < 1e-11);
  const double yaw = between(a, b).yaw;
  RC_ASSERT(yaw >= -kPi && yaw < kPi);
}

RC_GTEST_PROP(Pose2Test, TransformIsCompositionOfPoints, ()) {
  const Pose2 a = any_pose();
  const Pose2 b = any_pose();
  const Eigen::Vector2d p(any_within(100.0), any_within(100.0));
  RC_ASSERT((transform(compose(a, b), p) - transform(a, transform(b, p))).norm() < 1e-10);
  RC_ASSERT((transform(a, p) - (a.translation() + rotation(a.yaw) * p)).norm() < 1e-12);
}

TEST(Pose2Test, QuarterTurn) {
  const Pose2 a{1.0, 2.0, kPi / 2.0};
  EXPECT_LT((transform(a, {3.0, 0.0}) - Eigen::Vector2d(1.0, 5.0)).norm(), 1e-15);
  EXPECT_LT(distance(compose(a, {3.0, 1.0, kPi / 2.0}), {0.0, 5.0, kPi}), 1e-15);
  EXPECT_LT(distance(inverse(a), {-2.0, 1.0, -kPi / 2.0}), 1e-15);
}

TEST(WrapAngleTest, AtTheSeam) {
  EXPECT_EQ(wrap_angle(0.0), 0.0);
  EXPECT_EQ(wrap_angle(kPi), -kPi);
  EXPECT_EQ(wrap_angle(-kPi), -kPi);
  EXPECT_EQ(wrap_angle(3.0 * kPi), -kPi);
  const double below = std::nextafter(kPi, 0.0);
  EXPECT_NEAR(std::abs(wrap_angle(below)), kPi, 1e-15);
  EXPECT_NEAR(std::abs(wrap_angle(std::nextafter(-kPi, -4.0))), kPi, 1e-15);
  EXPECT_NEAR(wrap_angle(kPi + 0.25), -kPi + 0.25, 1e-15);
  EXPECT_NEAR(wrap_angle(-kPi - 0.25), kPi - 0.25, 1e-15);
}

TEST(WrapAngleTest, ManyTurnsAwayStaysInside) {
  // Found by StaysInItsInterval: the rounded product of 2 pi and the turns was off by more than a turn.
  const double angle = std::ldexp(-0.499999897, 57);
  EXPECT_EQ(wrap_angle(angle), std::remainder(angle, 2.0 * kPi));
  EXPECT_TRUE(std::isnan(wrap_angle(std::numeric_limits<double>::infinity())));
}

// Whatever finite number comes in, huge ones included, the result lies in [-pi, pi).
RC_GTEST_PROP(WrapAngleTest, StaysInItsInterval, ()) {
  const double angle = std::ldexp(any_within(1.0), *rc::gen::inRange(-1000, 1000));
  const double wrapped = wrap_angle(angle);
  RC_ASSERT(wrapped >= -kPi);
  RC_ASSERT(wrapped < kPi);
}

RC_GTEST_PROP(WrapAngleTest, TurnsDoNotMatter, ()) {
  const double angle = any_within(kPi);
  const int turns = *rc::gen::inRange(-1000, 1001);
  RC_ASSERT(std::abs(std::remainder(wrap_angle(angle + 2.0 * kPi * turns) - angle, 2.0 * kPi)) < 1e-11);
}

TEST(ExpTwistTest, KnownArcs) {
  // A quarter circle of radius 2 to the left.
  EXPECT_LT(distance(exp_twist({kPi, 0.0, kPi / 2.0}, 1.0), {2.0, 2.0, kPi / 2.0}), 1e-15);
  EXPECT_LT(distance(exp_twist({1.5, -0.5, 0.0}, 2.0), {3.0, -1.0, 0.0}), 1e-15);
  EXPECT_EQ(exp_twist({1.0, 2.0, 3.0}, 0.0), Pose2{});
}

RC_GTEST_PROP(ExpTwistTest, LogUndoesExp, ()) {
  // All magnitudes of the angle down to 2^-40, across the switch between series and closed form.
  const double duration_s = 0.025 * *rc::gen::inRange(1, 100);
  const double turn_rad = std::ldexp(any_within(3.1), -*rc::gen::inRange(0, 41));
  const Twist2 twist{any_within(5.0), any_within(5.0), turn_rad / duration_s};
  const Twist2 back = log_pose(exp_twist(twist, duration_s), duration_s);
  RC_ASSERT(std::abs(back.vx - twist.vx) < 1e-10);
  RC_ASSERT(std::abs(back.vy - twist.vy) < 1e-10);
  RC_ASSERT(std::abs(back.wz - twist.wz) < 1e-10);
}

TEST(ExpTwistTest, SeriesAndClosedFormMeet) {
  for (const double sign : {-1.0, 1.0}) {
    const Twist2 below{2.0, -1.0, sign * std::nextafter(1e-4, 0.0)};
    const Twist2 above{2.0, -1.0, sign * 1e-4};
    EXPECT_LT(distance(exp_twist(below, 1.0), exp_twist(above, 1.0)), 1e-11);
    const Twist2 log_below = log_pose({2.0, -1.0, below.wz}, 1.0);
    const Twist2 log_above = log_pose({2.0, -1.0, above.wz}, 1.0);
    EXPECT_NEAR(log_below.vx, log_above.vx, 1e-11);
    EXPECT_NEAR(log_below.vy, log_above.vy, 1e-11);
  }
}

RC_GTEST_PROP(InterpolateTest, EndsAreTheEndsAndHalvesAddUp, ()) {
  const Pose2 a = any_pose();
  const Pose2 b = compose(a, {any_within(10.0), any_within(10.0), any_within(3.1)});
  RC_ASSERT(distance(interpolate(a, b, 0.0), a) < 1e-12);
  RC_ASSERT(distance(interpolate(a, b, 1.0), b) < 1e-10);
  const Pose2 middle = interpolate(a, b, 0.5);
  RC_ASSERT(distance(between(a, middle), between(middle, b)) < 1e-10);
}

TEST(InterpolateTest, TakesTheShortWayAcrossTheSeam) {
  const Pose2 a{0.0, 0.0, kPi - 0.1};
  const Pose2 b{0.0, 0.0, -kPi + 0.1};
  EXPECT_NEAR(std::abs(wrap_angle(interpolate(a, b, 0.5).yaw)), kPi, 1e-12);
}

}  // namespace
}  // namespace submapd
