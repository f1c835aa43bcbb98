// Speed along a direction that little or nothing holds: learnt from few beams, kept when they are gone.
#include "slam/filter/axial_motion.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "slam/base/random.hpp"

namespace submapd {
namespace {

constexpr double kStep_s = 0.025;
const Eigen::Vector2d kAhead = Eigen::Vector2d::UnitX();

// The cart's filter along one axis: what Mapper does with predict(), update() and speed_gain().
struct Tracked {
  AxialMotion motion{AxialMotionOptions{}};
  double position_m = 0.0;
  double speed_m_s = 0.0;

  // One scan in which beams of this information measure the position.
  void scan(double measured_m, double information, bool lost = false) {
    const double variance = motion.predict(kStep_s, lost);
    const double predicted_m = position_m + speed_m_s * kStep_s;
    const double gain = variance / (variance + AxialMotionOptions{}.kappa / std::max(information, 1e-9));
    const double correction_m = gain * (measured_m - predicted_m);
    speed_m_s += motion.speed_gain() * correction_m;
    position_m = predicted_m + correction_m;
    motion.update(information);
  }
};

TEST(AxialMotionTest, ADozenBeamsTeachAColdCartItsSpeed) {
  Tracked cart;
  ASSERT_TRUE(cart.motion.cold());
  cart.motion.start();
  for (int k = 1; k <= 40; ++k) cart.scan(1.5 * kStep_s * k, 2e4);
  EXPECT_NEAR(cart.speed_m_s, 1.5, 0.03);
  EXPECT_NEAR(cart.position_m, 1.5, 0.01);
}

TEST(AxialMotionTest, FollowsAPushWithinCentimetresAndNotTheNoise) {
  Tracked cart;
  CounterRandom random(1, 0, 0);
  const double information = 1e4;  // two beams
  double worst_m = 0.0;
  double speed_square = 0.0;
  for (int k = 1; k <= 400; ++k) {
    const double t = kStep_s * k;
    const double truth_m =
        t < 5.0 ? 0.0 : 0.5 * std::min(t - 5.0, 2.0) * std::min(t - 5.0, 2.0) + 2.0 * std::max(t - 7.0, 0.0);
    cart.scan(truth_m + std::sqrt(1.0 / information) * random.gaussian(), information);
    if (t < 5.0) speed_square += cart.speed_m_s * cart.speed_m_s / 200.0;
    worst_m = std::max(worst_m, std::abs(cart.position_m - truth_m));
  }
  EXPECT_LT(worst_m, 0.03);
  EXPECT_LT(std::sqrt(speed_square), 0.15);
}

TEST(AxialMotionTest, SteadyStretchIgnoresWhatCameBeforeAndTheLastDoubtfulScans) {
  AxialMotion motion{AxialMotionOptions{}};
  for (int k = 0; k < 25; ++k) motion.note({0.5 * kStep_s, 0.0}, kStep_s, 0.0);
  for (int k = 0; k < 20; ++k) motion.note({2.0 * kStep_s, 0.0}, kStep_s, 0.0);
  EXPECT_FALSE(motion.cold());
  EXPECT_NEAR(motion.steady(kAhead).speed_m_s, 2.0, 0.01) << "the push is half a second ago";
  for (int k = 0; k < 4; ++k) motion.note({2.6 * kStep_s, 0.0}, kStep_s, 100.0);
  const AxialMotion::Steady steady = motion.steady(kAhead);
  EXPECT_NEAR(steady.speed_m_s, 2.0, 0.05);
  EXPECT_NEAR(steady.offset_m, -4 * 0.6 * kStep_s, 0.01) << "where it would be without them";
  EXPECT_LT(steady.sigma_m_s, 0.05);
  EXPECT_NEAR(motion.steady(Eigen::Vector2d::UnitY()).speed_m_s, 0.0, 1e-9);
}

TEST(AxialMotionTest, KeepsItsSpeedWhileNothingHoldsItAndSaysHowUnsureItGets) {
  AxialMotion motion{AxialMotionOptions{}};
  for (int k = 0; k < 40; ++k) motion.note({1.5 * kStep_s, 0.0}, kStep_s, 0.0);
  motion.go_on(motion.steady(kAhead));
  double before = 0.0;
  for (int k = 0; k < 200; ++k) {
    const double variance = motion.predict(kStep_s, true);
    EXPECT_GT(variance, before);
    before = variance;
    motion.update(0.0);
  }
  EXPECT_GT(std::sqrt(before), 0.5) << "five seconds blind";
  EXPECT_LT(std::sqrt(before), 3.0);
}

// A rolling cart keeps its speed in a blank corridor. One that stands there is pushed off, and nothing tells when.
TEST(AxialMotionTest, ACartThatJustStoodIsBelievedToSpeedUp) {
  const auto variance_after_a_second = [](double speed_m_s, double before_s) {
    AxialMotion motion{AxialMotionOptions{}};
    for (int k = 0; k < 40; ++k) motion.note({speed_m_s * kStep_s, 0.0}, kStep_s, 0.0);
    motion.note_speed(0.0, kStep_s);
    EXPECT_TRUE(motion.pushed());
    motion.note_speed(speed_m_s, before_s);
    motion.go_on(motion.steady(kAhead));
    double variance = 0.0;
    for (int k = 0; k < 40; ++k) variance = motion.predict(kStep_s, true);
    return variance;
  };
  const double rolling = variance_after_a_second(1.5, 10.0);
  EXPECT_GT(variance_after_a_second(1.5, 0.5), 4.0 * rolling) << "set off half a second ago";
  EXPECT_GT(variance_after_a_second(0.1, 10.0), 4.0 * rolling) << "stands";
}

}  // namespace
}  // namespace submapd
