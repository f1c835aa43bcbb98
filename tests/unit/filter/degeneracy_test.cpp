// The latch: in at once, out only after a while, and the uncertainty that grows in between.
#include "slam/filter/degeneracy.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <initializer_list>
#include <numbers>

namespace submapd {
namespace {

constexpr double kStep_s = 0.025;

// Information with the given ratio of eigenvalues, the normals' noise floor on top; weak along `axis_rad`.
Eigen::Matrix3d information(double ratio, double axis_rad, double scale = 1e6) {
  const DegeneracyOptions options;
  // (low - f) / (high - f) = ratio with f = share * (low + high), high = 1.
  const double s = options.normal_noise_share;
  const double low = (ratio + s * (1.0 - ratio)) / (1.0 - s * (1.0 - ratio));
  const Eigen::Vector2d axis(std::cos(axis_rad), std::sin(axis_rad));
  const Eigen::Vector2d across(-axis.y(), axis.x());
  Eigen::Matrix3d H = Eigen::Matrix3d::Identity() * scale;
  H.topLeftCorner<2, 2>() = scale * (low * axis * axis.transpose() + across * across.transpose());
  return H;
}

// Nothing faces the axis.
void lose(DegeneracyMonitor& monitor) {
  for (int k = 0; k < DegeneracyOptions{}.lost_scans; ++k) monitor.hold(0.0);
}

TEST(DegeneracyMonitorTest, EntersAtOnceAndKnowsTheAxis) {
  const DegeneracyOptions options;
  DegeneracyMonitor monitor(options);
  monitor.update(information(1.05 * options.enter_ratio, 0.7), 500, kStep_s);
  EXPECT_FALSE(monitor.weak());
  monitor.update(information(0.95 * options.enter_ratio, 0.7), 500, kStep_s);
  ASSERT_TRUE(monitor.weak());
  EXPECT_NEAR(std::abs(monitor.axis().dot(Eigen::Vector2d(std::cos(0.7), std::sin(0.7)))), 1.0, 1e-6);
  EXPECT_NEAR(monitor.axis().norm(), 1.0, 1e-9);
}

TEST(DegeneracyMonitorTest, ABlankCorridorHasNothingAlong) {
  DegeneracyMonitor monitor{DegeneracyOptions{}};
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  H(1, 1) = 1e6;
  monitor.update(H, 500, kStep_s);
  ASSERT_TRUE(monitor.weak());
  EXPECT_NEAR(std::abs(monitor.axis().x()), 1.0, 1e-9);
}

TEST(DegeneracyMonitorTest, StaysBetweenTheThresholdsAndLeavesAfterEightGoodScansInARow) {
  const DegeneracyOptions options;
  DegeneracyMonitor monitor(options);
  monitor.update(information(0.01, 0.0), 500, kStep_s);
  const double between = 0.5 * (options.enter_ratio + options.leave_ratio);
  const double good = 1.05 * options.leave_ratio;
  for (int k = 0; k < 100; ++k) monitor.update(information(between, 0.0), 500, kStep_s);
  EXPECT_TRUE(monitor.weak());
  for (int k = 0; k < options.leave_scans - 1; ++k) monitor.update(information(good, 0.0), 500, kStep_s);
  EXPECT_TRUE(monitor.weak());
  monitor.update(information(between, 0.0), 500, kStep_s);  // breaks the row
  for (int k = 0; k < options.leave_scans - 1; ++k) monitor.update(information(good, 0.0), 500, kStep_s);
  EXPECT_TRUE(monitor.weak());
  monitor.update(information(good, 0.0), 500, kStep_s);
  EXPECT_FALSE(monitor.weak());
  EXPECT_EQ(monitor.axial_variance_m2(), 0.0);
}

TEST(DegeneracyMonitorTest, FewPointsConcludeNothing) {
  DegeneracyMonitor monitor{DegeneracyOptions{}};
  monitor.update(information(0.001, 0.0), 39, kStep_s);
  EXPECT_FALSE(monitor.weak());
  monitor.update(Eigen::Matrix3d::Zero(), 0, kStep_s);
  EXPECT_FALSE(monitor.weak());
  monitor.update(information(0.001, 0.0), 40, kStep_s);
  EXPECT_TRUE(monitor.weak());
  lose(monitor);
  for (int k = 0; k < 50; ++k) monitor.update(information(0.5, 0.0), 39, kStep_s);
  EXPECT_TRUE(monitor.active());
  EXPECT_NEAR(monitor.time_s(), 50 * kStep_s, 1e-9) << "time passes all the same";
}

TEST(DegeneracyMonitorTest, AFewBeamsThatFaceTheAxisHoldIt) {
  const DegeneracyOptions o;
  const double lost = o.kappa / (o.lost_sigma_m * o.lost_sigma_m);
  const double found = o.kappa / (o.found_sigma_m * o.found_sigma_m);
  DegeneracyMonitor monitor(o);
  monitor.update(information(0.001, 0.0), 500, kStep_s);
  for (int k = 0; k < 100; ++k) monitor.hold(1.01 * lost);
  EXPECT_FALSE(monitor.active()) << "weak, but held";
  for (int k = 0; k < o.lost_scans - 1; ++k) monitor.hold(0.99 * lost);
  EXPECT_FALSE(monitor.active()) << "one scan's people are not the end of a wall";
  monitor.hold(1.01 * lost);
  for (int k = 0; k < o.lost_scans; ++k) monitor.hold(0.99 * lost);
  EXPECT_TRUE(monitor.active());
  for (int k = 0; k < 100; ++k) monitor.hold(0.99 * found);
  EXPECT_TRUE(monitor.active()) << "between the thresholds";
  for (int k = 0; k < o.leave_scans; ++k) monitor.hold(1.01 * found);
  EXPECT_FALSE(monitor.active());
  EXPECT_TRUE(monitor.weak());
  EXPECT_EQ(monitor.axial_information(), 1.01 * found);
}

TEST(DegeneracyMonitorTest, VarianceAlongTheAxisGrowsAsDocumented) {
  const DegeneracyOptions o;
  DegeneracyMonitor monitor(o);
  monitor.update(information(0.01, 0.0), 500, 1.0);
  lose(monitor);
  EXPECT_EQ(monitor.axial_variance_m2(), 0.0) << "nothing is lost at entry";
  double before = 0.0;
  for (int k = 1; k <= 10; ++k) {
    monitor.update(information(0.01, 0.0), 500, 1.0);
    const double t = k;
    const double expected = std::pow(o.speed_sigma_m_s * t, 2) + std::pow(0.5 * o.accel_sigma_m_s2 * t * t, 2);
    EXPECT_NEAR(monitor.axial_variance_m2(), expected, 1e-12);
    EXPECT_GT(monitor.axial_variance_m2(), before);
    before = monitor.axial_variance_m2();
  }
  // A new span starts from nothing.
  for (int k = 0; k < o.leave_scans; ++k) monitor.update(information(0.5, 0.0), 500, 1.0);
  monitor.update(information(0.01, 0.0), 500, 1.0);
  lose(monitor);
  EXPECT_TRUE(monitor.active());
  EXPECT_EQ(monitor.axial_variance_m2(), 0.0);
}

TEST(DegeneracyMonitorTest, TheAxisFollowsTheCorridorAndTheFrame) {
  const DegeneracyOptions options;
  DegeneracyMonitor monitor(options);
  monitor.update(information(0.01, 0.0), 500, kStep_s);
  monitor.update(information(1.05 * options.enter_ratio, 0.3), 500, kStep_s);
  EXPECT_NEAR(std::abs(monitor.axis().x()), 1.0, 1e-6) << "not sure enough to turn the axis";
  monitor.update(information(0.01, 0.3), 500, kStep_s);
  EXPECT_NEAR(std::abs(monitor.axis().y()), std::sin(0.3), 1e-6);
  monitor.change_frame(-0.3);
  EXPECT_NEAR(std::abs(monitor.axis().x()), 1.0, 1e-6);
}

// Walls about `centre`, seen from the origin in directions from `from_rad` to `to_rad` off it.
Eigen::Matrix3d round_walls(const Eigen::Vector2d& centre, std::initializer_list<double> radii_m, double from_rad,
                            double to_rad) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  for (const double radius_m : radii_m) {
    for (double angle = from_rad; angle < to_rad; angle += 0.01) {
      const Eigen::Vector2d n(std::cos(angle), std::sin(angle));
      const Eigen::Vector2d p = centre + radius_m * n;
      const Eigen::Vector3d row(n.x(), n.y(), p.x() * n.y() - p.y() * n.x());
      H += 1e4 * row * row.transpose();
    }
  }
  return H;
}

TEST(DegeneracyMonitorTest, InARoundCorridorItIsTheWayRoundThatIsWeak) {
  DegeneracyMonitor monitor{DegeneracyOptions{}};
  const double half = std::numbers::pi / 2.0;
  monitor.update(round_walls({0.0, 14.0}, {12.7, 15.3}, -half - 0.6, -half + 0.6), 500, kStep_s);
  ASSERT_TRUE(monitor.weak());
  EXPECT_NEAR(std::abs(monitor.axis().x()), 1.0, 1e-3);
  EXPECT_NEAR(monitor.turn_rad_m() * monitor.axis().x(), 1.0 / 14.0, 1e-3);
}

// Straight ahead it is nearly as weak: a motion along that axis would lead into the wall.
TEST(DegeneracyMonitorTest, TheWayRoundGoesBeforeTheWayAhead) {
  DegeneracyOptions options;
  options.enter_ratio = 0.9;
  DegeneracyMonitor monitor(options);
  const double half = std::numbers::pi / 2.0;
  monitor.update(round_walls({0.0, 14.0}, {12.7, 15.3}, -half - 0.6, -half + 0.6), 500, kStep_s);
  ASSERT_TRUE(monitor.weak());
  EXPECT_NEAR(monitor.turn_rad_m() * monitor.axis().x(), 1.0 / 14.0, 1e-3);
}

TEST(DegeneracyMonitorTest, ARoundRoomHoldsItsMiddle) {
  DegeneracyMonitor monitor{DegeneracyOptions{}};
  Eigen::Matrix3d H = round_walls({0.0, 0.0}, {5.0}, 0.0, 2.0 * std::numbers::pi);
  monitor.update(H, 500, kStep_s);
  EXPECT_FALSE(monitor.weak()) << "only its heading is free";
}

}  // namespace
}  // namespace submapd
