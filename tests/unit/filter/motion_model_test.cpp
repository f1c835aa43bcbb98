// Prediction, learning and the period of stamps that come in bursts; whether odometry is believed.
#include "slam/filter/motion_model.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"
#include "slam/filter/internal/odometry_gate.hpp"

namespace submapd {
namespace {

constexpr double kHalfTurn = std::numbers::pi;

TEST(MotionModelTest, TwistPredictsAQuarterCircle) {
  // 1 m/s and 90 deg/s for a second: an arc of radius 2 / pi.
  const PredictedMotion motion = predict_by_twist({1.0, 0.0, kHalfTurn / 2.0}, 1.0, {});
  EXPECT_NEAR(motion.delta.x, 2.0 / kHalfTurn, 1e-12);
  EXPECT_NEAR(motion.delta.y, 2.0 / kHalfTurn, 1e-12);
  EXPECT_NEAR(motion.delta.yaw, kHalfTurn / 2.0, 1e-12);
}

TEST(MotionModelTest, SigmaGrowsWithTheSquareOfTheStepAndSaturates) {
  const MotionModelOptions options;
  const PredictedMotion one = predict_by_twist({}, 0.025, options);
  EXPECT_NEAR(one.sigma(0), 0.5 * options.accel_sigma * 0.025 * 0.025, 1e-12);
  EXPECT_NEAR(one.sigma(2), 0.5 * options.yaw_accel_sigma * 0.025 * 0.025, 1e-12);
  const PredictedMotion two = predict_by_twist({}, 0.05, options);
  EXPECT_NEAR(two.sigma(1), 4.0 * one.sigma(1), 1e-12);
  for (const double step_s : {10.0, 1e4, 1e12}) {
    const PredictedMotion late = predict_by_twist({3.0, 0.0, 1.0}, step_s, options);
    EXPECT_EQ(late.sigma(0), options.max_sigma_m);
    EXPECT_EQ(late.sigma(2), options.max_sigma_rad);
    EXPECT_EQ(late.delta, predict_by_twist({3.0, 0.0, 1.0}, options.max_extrapolation_s, options).delta)
        << "nobody drives on blindly for hours";
  }
}

TEST(MotionModelTest, ConstantTwistIsLearnt) {
  const Twist2 truth{2.0, -0.1, 0.8};
  Twist2 twist;
  for (int k = 0; k < 30; ++k) twist = learn_twist(twist, exp_twist(truth, 0.025), 0.025, {});
  EXPECT_NEAR(twist.vx, truth.vx, 1e-9);
  EXPECT_NEAR(twist.vy, truth.vy, 1e-9);
  EXPECT_NEAR(twist.wz, truth.wz, 1e-9);
}

TEST(MotionModelTest, OneStepTakesTheShareOfSmoothing) {
  const Twist2 twist = learn_twist({1.0, 0.0, 0.0}, exp_twist({2.0, 0.0, 0.0}, 0.1), 0.1, {});
  EXPECT_NEAR(twist.vx, 1.7, 1e-12);
}

TEST(MotionModelTest, WhatACartCannotDoIsNotLearnt) {
  const Twist2 before{1.0, 0.0, 0.2};
  EXPECT_EQ(learn_twist(before, exp_twist({4.6, 0.0, 0.0}, 0.025), 0.025, {}), before);
  EXPECT_EQ(learn_twist(before, exp_twist({3.3, 3.3, 0.0}, 0.025), 0.025, {}), before);
  EXPECT_EQ(learn_twist(before, exp_twist({0.0, 0.0, -4.1}, 0.025), 0.025, {}), before);
  EXPECT_NE(learn_twist(before, exp_twist({4.4, 0.0, 3.9}, 0.025), 0.025, {}), before);
}

TEST(MotionModelTest, OdometrySigmasFollowTheMotion) {
  const MotionModelOptions o;
  const PredictedMotion motion = predict_by_odometry({0.3, 0.4, -0.2}, o);
  EXPECT_EQ(motion.delta, (Pose2{0.3, 0.4, -0.2}));
  EXPECT_NEAR(motion.sigma(0), o.odom_base_m + 0.5 * o.odom_per_m + 0.2 * o.odom_m_per_rad, 1e-12);
  EXPECT_NEAR(motion.sigma(2), o.odom_base_rad + 0.2 * o.odom_rad_per_rad + 0.5 * o.odom_rad_per_m, 1e-12);
}

TEST(MotionModelTest, InformationTurnsWithTheCart) {
  PredictedMotion motion;
  motion.sigma = {0.1, 1.0, 0.5};
  const Eigen::Matrix3d ahead = motion_information(motion, kHalfTurn / 2.0);  // the cart's x axis is the map's y axis
  EXPECT_NEAR(ahead(0, 0), 1.0, 1e-9);
  EXPECT_NEAR(ahead(1, 1), 100.0, 1e-9);
  EXPECT_NEAR(ahead(2, 2), 4.0, 1e-9);
  EXPECT_NEAR(ahead(0, 1), 0.0, 1e-9);
}

// Stamps of the Intel log as a whole: 918 of 5437 steps are shorter than 20 ms, the scans were taken every 0.2 s or so.
TEST(PeriodEstimatorTest, BurstsDoNotShortenThePeriod) {
  PeriodEstimator period;
  for (std::uint64_t k = 0; k < 5437; ++k) {
    CounterRandom random(1, k, 0);
    const bool burst = random.uniform() < 918.0 / 5437.0;
    period.add(burst ? random.uniform(0.0001, 0.02) : random.uniform(0.18, 0.26));
    if (k > 100) {
      ASSERT_GT(period.usual_s(), 0.12) << "after " << k;
    }
    if (k > 100) {
      ASSERT_LT(period.usual_s(), 0.26) << "after " << k;
    }
  }
}

// Most of the Intel log's last minutes: six scans at once, then one after half a second, then two seconds of nothing.
TEST(PeriodEstimatorTest, WhereMostComeInBurstsTheMeanIsThePeriod) {
  PeriodEstimator period;
  for (int k = 0; k < 50; ++k) {
    for (int i = 0; i < 5; ++i) period.add(0.002);
    period.add(0.5);
    period.add(0.6);
    period.add(2.3);
  }
  EXPECT_TRUE(period.bursting());
  EXPECT_GT(period.usual_s(), 0.25);
  EXPECT_LT(period.usual_s(), 0.5);
}

// The Intel log's first half minute: taken for a fast log, its scans were held to weak axes, and taken for a log of
// bursts, its next hundred were predicted to stand still.
TEST(PeriodEstimatorTest, ABurstAtTheBeginningSaysNothing) {
  PeriodEstimator period;
  for (int k = 0; k < 28; ++k) period.add(0.002);
  EXPECT_FALSE(period.bursting());
  EXPECT_EQ(period.usual_s(), PeriodEstimator().usual_s());
  period.add(28.2);
  period.add(0.94);
  EXPECT_TRUE(period.bursting()) << "of two, one is far shorter than their mean";
  EXPECT_GT(period.usual_s(), 0.06);
  for (int k = 0; k < 18; ++k) {
    period.add(0.94);
    ASSERT_GT(period.usual_s(), 0.06);
  }
  EXPECT_FALSE(period.bursting());
}

TEST(PeriodEstimatorTest, NeitherGapsNorMissingScansAreBursts) {
  PeriodEstimator period;
  for (int k = 0; k < 300; ++k) {
    period.add(k == 250 ? 10.0 : 0.025);
    ASSERT_FALSE(period.bursting()) << k;
    ASSERT_EQ(period.usual_s(), 0.025) << k;
  }
  for (int k = 0; k < 300; ++k) {
    period.add(k % 4 == 0 ? 0.4 : 0.2);
    if (k > 101) {
      ASSERT_FALSE(period.bursting()) << k;
      ASSERT_EQ(period.usual_s(), 0.2) << k;
    }
  }
}

TEST(MotionModelTest, OfALongStepOnlyItsBeginningIsTrusted) {
  const MotionModelOptions options;
  EXPECT_EQ(trusted_time_s(0.025, options), 0.025);
  EXPECT_EQ(trusted_time_s(options.steady_s, options), options.steady_s);
  double before_s = options.steady_s;
  for (const double step_s : {0.1, 0.2, 0.5, 1.0, 10.0}) {
    const double trusted_s = trusted_time_s(step_s, options);
    EXPECT_GT(trusted_s, before_s);
    EXPECT_LE(trusted_s, std::min(step_s, options.steady_s + options.push_s));
    before_s = trusted_s;
  }
}

TEST(PredictionErrorTest, SaysNothingUntilItHasSeenSome) {
  PredictionError error;
  const Eigen::Vector3d of_motion(0.6, 0.6, 0.5);
  for (int k = 0; k < 19; ++k) {
    error.add({0.01, 0.0, 0.0});
    EXPECT_EQ(error.sigma(of_motion, 1.0), of_motion) << k;
  }
}

TEST(PredictionErrorTest, IsTwiceTheUsualErrorAndGrowsWithTheStep) {
  PredictionError error;
  for (int k = 0; k < 200; ++k) error.add({k % 2 == 0 ? 0.03 : -0.03, 0.04, 0.1});
  const Eigen::Vector3d wide(10.0, 10.0, 10.0);
  const double axis_m = 0.05 / std::sqrt(2.0);
  EXPECT_NEAR(error.sigma(wide, 1.0)(0), 2.0 * axis_m, 1e-9);
  EXPECT_NEAR(error.sigma(wide, 1.0)(1), 2.0 * axis_m, 1e-9);
  EXPECT_NEAR(error.sigma(wide, 1.0)(2), 0.2, 1e-9);
  EXPECT_NEAR(error.sigma(wide, 3.0)(2), 0.6, 1e-9);
  const Eigen::Vector3d narrow(0.01, 0.01, 0.01);
  EXPECT_EQ(error.sigma(narrow, 1.0), narrow);
}

TEST(PeriodEstimatorTest, FollowsAndIgnoresWhatIsNoPeriod) {
  PeriodEstimator period;
  period.add(0.2);
  EXPECT_EQ(period.usual_s(), 0.2);
  for (int k = 0; k < 200; ++k) {
    period.add(0.0);
    period.add(-5.0);
    period.add(std::nan(""));
  }
  EXPECT_EQ(period.usual_s(), 0.2);
  for (int k = 0; k < 70; ++k) period.add(0.025);
  EXPECT_EQ(period.usual_s(), 0.025);
  for (int k = 0; k < 200; ++k) period.add(0.1);
  EXPECT_EQ(period.usual_s(), 0.1);
}

// Drives the gate along a path; odometry sees each step through `seen`.
struct Drive {
  OdometryGate gate{MotionModelOptions{}};
  Pose2 odometry;
  int used = 0;

  template <typename See>
  void go(int steps, See see) {
    for (int k = 0; k < steps; ++k) {
      const Pose2 truth = exp_twist({1.5, 0.0, 0.4 * std::sin(0.05 * k)}, 0.1);
      odometry = compose(odometry, see(truth, k));
      const std::optional<Pose2> delta = gate.motion(odometry);
      if (!delta) continue;
      ++used;
      gate.judge(*delta, truth);
    }
  }
};

TEST(OdometryGateTest, ConstantOdometryIsNotUsed) {
  Drive drive;
  drive.go(500, [](const Pose2&, int) { return Pose2{}; });
  EXPECT_EQ(drive.used, 0);
  EXPECT_FALSE(drive.gate.rejected());
  EXPECT_EQ(drive.gate.motion(std::nullopt), std::nullopt);
}

TEST(OdometryGateTest, GoodOdometryIsKept) {
  Drive drive;
  drive.go(2000, [](const Pose2& truth, int k) {
    CounterRandom random(3, static_cast<std::uint64_t>(k), 0);
    return Pose2{truth.x * 1.03 + 0.01 * random.gaussian(), 0.01 * random.gaussian(),
                 truth.yaw + 0.01 * random.gaussian()};
  });
  EXPECT_FALSE(drive.gate.rejected());
  EXPECT_EQ(drive.used, 1999);
}

TEST(OdometryGateTest, OdometryThatContradictsIsRejectedForGood) {
  Drive drive;
  drive.go(200, [](const Pose2& truth, int) { return Pose2{5.0 * truth.x, 0.0, truth.yaw}; });
  EXPECT_TRUE(drive.gate.rejected());
  EXPECT_EQ(drive.used, 40) << "rejected at the fortieth contradiction";
  const int used_before = drive.used;
  drive.go(200, [](const Pose2& truth, int) { return truth; });
  EXPECT_EQ(drive.used, used_before);
}

TEST(OdometryGateTest, WrongHeadingAloneIsRejectedToo) {
  Drive drive;
  drive.go(200, [](const Pose2& truth, int) { return Pose2{truth.x, truth.y, truth.yaw + 0.4}; });
  EXPECT_TRUE(drive.gate.rejected());
}

TEST(OdometryGateTest, AnOutlierInTenIsForgiven) {
  Drive drive;
  drive.go(5000, [](const Pose2& truth, int k) { return k % 10 == 0 ? Pose2{truth.x + 1.0, 0.0, 0.0} : truth; });
  EXPECT_FALSE(drive.gate.rejected());
}

TEST(OdometryGateTest, ALogWithHolesInItsOdometryIsUsedAroundThem) {
  OdometryGate gate{MotionModelOptions{}};
  EXPECT_EQ(gate.motion(Pose2{}), std::nullopt) << "the first";
  EXPECT_TRUE(gate.motion(Pose2{1.0, 0.0, 0.0}).has_value());
  EXPECT_EQ(gate.motion(std::nullopt), std::nullopt);
  EXPECT_EQ(gate.motion(Pose2{2.0, 0.0, 0.0}), std::nullopt) << "nothing to compare with";
  EXPECT_EQ(gate.motion(Pose2{3.0, 0.0, 0.0}), (Pose2{1.0, 0.0, 0.0}));
}

}  // namespace
}  // namespace submapd
