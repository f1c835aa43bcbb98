#include "slam/matching/scan_points.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace submapd {
namespace {

constexpr double kPi = std::numbers::pi;

// Ranges of a wall x = wall_m in the world, for a base that moves with the twist from the origin during the sweep.
Scan moving_scan(double wall_m, const Twist2& twist, const Pose2& base_from_sensor = {}) {
  Scan scan;
  scan.geometry.first_angle_rad = -1.0;
  scan.geometry.angle_step_rad = 2.0 / 800;
  scan.geometry.sweep_s = 0.025;
  scan.geometry.base_from_sensor = base_from_sensor;
  for (int i = 0; i <= 800; ++i) {
    const double tau = 0.025 * i / 800.0;
    const Pose2 sensor = compose(exp_twist(twist, tau), base_from_sensor);
    const double angle = sensor.yaw - 1.0 + i * 2.0 / 800;
    scan.ranges_mm.push_back(static_cast<std::uint16_t>(std::lround(1e3 * (wall_m - sensor.x) / std::cos(angle))));
  }
  return scan;
}

// Largest distance of the unwarped points from the wall.
double worst(const Scan& scan, const Twist2& twist, double wall_m) {
  ScanPoints points({}, 1081);
  points.assign(scan, twist);
  EXPECT_EQ(points.all().size(), scan.ranges_mm.size());
  double out = 0.0;
  for (const ScanPoint& p : points.all()) out = std::max(out, std::abs(static_cast<double>(p.x) - wall_m));
  return out;
}

TEST(ScanPointsTest, UnwarpingWhileDrivingTurnsAndBoth) {
  struct Case {
    Twist2 twist;
    double smear_m;  // of the last beam, without unwarping, at least
  };
  for (const auto& [twist, smear_m] : {Case{{3.0, 0.0, 0.0}, 0.070}, Case{{-3.0, 0.0, 0.0}, 0.070},
                                       Case{{0.0, 0.0, 1.5}, 0.2}, Case{{3.0, 0.3, -1.5}, 0.15}}) {
    const Scan scan = moving_scan(5.0, twist, {0.2, -0.1, 0.05});
    const double right = worst(scan, twist, 5.0);
    const double off = worst(scan, {}, 5.0);
    const double wrong = worst(scan, {-twist.vx, -twist.vy, -twist.wz}, 5.0);
    EXPECT_LT(right, 0.0015);  // rounded millimetres, and the third order of the turn
    EXPECT_GT(off, smear_m);
    EXPECT_NEAR(wrong / off, 2.0, 0.15);
  }
}

RC_GTEST_PROP(ScanPointsTest, SecondOrderAgreesWithTheExponential, ()) {
  const Twist2 twist{*rc::gen::inRange(-300, 301) * 0.01, *rc::gen::inRange(-100, 101) * 0.01,
                     *rc::gen::inRange(-200, 201) * 0.01};
  const double range = *rc::gen::inRange(200, 29000) * 1e-3;
  Scan scan;
  scan.geometry.sweep_s = 0.025;
  scan.ranges_mm.assign(101, static_cast<std::uint16_t>(std::lround(range * 1e3)));
  ScanPoints points({}, 1081);
  points.assign(scan, twist);
  RC_ASSERT(points.beams().size() == 101U);
  const double phi = std::abs(twist.wz) * 0.025;
  const double way = std::hypot(twist.vx, twist.vy) * 0.025;
  // Left out: phi^3 / 6 of the range and phi^2 / 6 of the way; the rest is single precision.
  const double limit = phi * phi * phi / 6.0 * range + phi * phi / 6.0 * way + 1e-6 + 4e-7 * range;
  for (std::size_t i = 0; i < 101; ++i) {
    const double angle = scan.geometry.first_angle_rad + static_cast<double>(i) * scan.geometry.angle_step_rad;
    const Pose2 moved = exp_twist(twist, 0.025 * static_cast<double>(i) / 100.0);
    const Eigen::Vector2d exact = transform(moved, {range * std::cos(angle), range * std::sin(angle)});
    const BeamEnd& end = points.beams()[i];
    RC_ASSERT(std::hypot(static_cast<double>(end.x) - exact.x(), static_cast<double>(end.y) - exact.y()) < limit);
  }
  const Eigen::Vector2d origin = exp_twist(twist, 0.0125).translation();
  RC_ASSERT((points.origin().cast<double>() - origin).norm() < 1e-6);
}

Scan still(std::vector<std::uint16_t> ranges) {
  Scan scan;
  scan.ranges_mm = std::move(ranges);
  return scan;
}

TEST(ScanPointsTest, FiltersBeamsThatAreNoMeasurement) {
  ScanPoints points({}, 1081);
  points.assign(still({0, 1, 99, 100, 100, 29999, 29999, 30000, 65535}), {});
  ASSERT_EQ(points.beams().size(), 9U);
  const std::vector<bool> kept{false, false, false, true, true, true, true, false, false};
  std::size_t n = 0;
  for (std::size_t i = 0; i < 9; ++i) {
    const BeamEnd& b = points.beams()[i];
    EXPECT_EQ(b.range_m > 0.0F, kept[i]) << i;
    if (kept[i]) {
      EXPECT_TRUE(b.hit);
    }
    n += kept[i] ? 1U : 0U;
  }
  EXPECT_EQ(points.all().size(), n);
  points.assign(still({0, 0, 1, 0}), {});
  EXPECT_TRUE(points.all().empty());
  EXPECT_TRUE(points.thinned().empty());
  EXPECT_EQ(points.rms_range_m(), 0.0);
  EXPECT_EQ(points.far_range_m(), 0.0);
  points.assign(still({}), {});
  EXPECT_TRUE(points.beams().empty());
}

TEST(ScanPointsTest, ErrorCodeMayMeanFree) {
  ScanPointOptions options;
  options.error_code_is_free = true;
  ScanPoints points(options, 1081);
  points.assign(still({0, 1, 2000}), {});
  EXPECT_EQ(points.beams()[0].range_m, 0.0F);
  EXPECT_EQ(points.beams()[1].range_m, 30.0F);
  EXPECT_FALSE(points.beams()[1].hit);
  EXPECT_TRUE(points.beams()[2].hit);
  EXPECT_EQ(points.all().size(), 1U);
}

TEST(ScanPointsTest, BeamsBeyondTheLimitAreIgnored) {
  ScanPoints points({}, 10);
  points.assign(still(std::vector<std::uint16_t>(20, 2000)), {});
  EXPECT_EQ(points.beams().size(), 10U);
  EXPECT_EQ(points.all().size(), 10U);
}

TEST(ScanPointsTest, VeilsAreFreeButNoHitsAndCornersStay) {
  ScanPoints points({}, 1081);
  // From 2 m to 4 m through two points in the air.
  points.assign(still({2000, 2000, 2600, 3300, 4000, 4000}), {});
  EXPECT_TRUE(points.beams()[1].hit);
  EXPECT_FALSE(points.beams()[2].hit);
  EXPECT_FALSE(points.beams()[3].hit);
  EXPECT_NEAR(points.beams()[2].range_m, 2.6F, 1e-5F);
  EXPECT_TRUE(points.beams()[4].hit);
  EXPECT_EQ(points.all().size(), 4U);
  // An edge without a veil, a spike (pole in front), and a notch: all real.
  points.assign(still({2000, 2000, 4000, 4000, 2000, 4000, 4000, 6000, 4000}), {});
  EXPECT_EQ(points.all().size(), 9U);
  // A real corner, convex and concave, of two walls seen at 45 deg from 3 m, and a wall at grazing incidence of 10 deg.
  for (const double fold : {1.0, -1.0}) {
    std::vector<std::uint16_t> ranges;
    for (int i = -80; i <= 80; ++i) {
      const double a = i * kPi / 720.0;
      ranges.push_back(static_cast<std::uint16_t>(
          std::lround(3000.0 * std::sin(kPi / 4.0) / std::sin(kPi / 4.0 + fold * std::abs(a)))));
    }
    points.assign(still(ranges), {});
    EXPECT_EQ(points.all().size(), ranges.size());
  }
  std::vector<std::uint16_t> grazing;
  for (int i = 0; i < 40; ++i) {
    grazing.push_back(static_cast<std::uint16_t>(std::lround(1500.0 / std::sin(kPi / 18.0 + i * kPi / 720.0))));
  }
  points.assign(still(grazing), {});
  EXPECT_EQ(points.all().size(), grazing.size());
}

TEST(ScanPointsTest, WhatStandsBeforeAllBesideItIsAlone) {
  ScanPoints points({}, 1081);
  const auto alone = [&](std::vector<std::uint16_t> ranges) {
    points.assign(still(std::move(ranges)), {});
    std::string marks;
    for (const ScanPoint& p : points.all()) marks += p.alone ? 'x' : '.';
    return marks;
  };
  EXPECT_EQ(alone({4000, 4000, 2000, 2010, 2000, 4000, 4000}), "..xxx..") << "somebody in the corridor";
  EXPECT_EQ(alone({4000, 4000, 2000, 0, 2000, 4000, 4000}), "..xx..");
  EXPECT_EQ(alone({4000, 4000, 3880, 3880, 4000, 4000}), "......") << "a pilaster";
  EXPECT_EQ(alone({2000, 2000, 2000, 4000, 4000}), ".....") << "the end of a wall";
  EXPECT_EQ(alone({3000, 3000, 2000, 2000, 4000, 4000, 2500, 2500}), "..xx....")
      << "what it hides part of, and the last";
  std::vector<std::uint16_t> wide(240, 2000);  // 2 m across
  wide.insert(wide.begin(), 2, 4000);
  wide.insert(wide.end(), 2, 4000);
  EXPECT_EQ(alone(wide), std::string(wide.size(), '.'));
  EXPECT_EQ(alone({}), "");
}

TEST(ScanPointsTest, ViewsAndWeights) {
  ScanPoints points({}, 1081);
  points.assign(still(std::vector<std::uint16_t>(1081, 2000)), {});
  for (const ScanPoint& p : points.all()) {
    EXPECT_NEAR(p.view_x * p.x + p.view_y * p.y, -2.0F, 1e-4F);
    EXPECT_NEAR(p.weight, std::sqrt(2.0F * static_cast<float>(kPi) / 720.0F / 0.1F), 1e-3F);
  }
  EXPECT_NEAR(points.rms_range_m(), 2.0, 1e-6);
  EXPECT_NEAR(points.far_range_m(), 2.0, 1e-6);
  EXPECT_NEAR(points.angle_step_rad(), kPi / 720.0, 1e-12);
}

// Thinned points keep their distance, are points of the scan in its order, and are at most thin_to, whatever the scan:
// a hall of columns and crowds is all jumps.
RC_GTEST_PROP(ScanPointsTest, ThinningKeepsItsCountAndSpacing, ()) {
  const int kind = *rc::gen::inRange(0, 3);
  std::vector<std::uint16_t> ranges;
  for (int i = 0; i < 1081; ++i) {
    if (kind == 0) ranges.push_back(static_cast<std::uint16_t>(*rc::gen::inRange(100, 30000)));
    if (kind == 1) ranges.push_back(static_cast<std::uint16_t>(3000 + *rc::gen::inRange(-20, 20)));
    if (kind == 2) ranges.push_back(static_cast<std::uint16_t>(i % 2 == 0 ? 3000 : 29000));
  }
  const Scan scan = still(ranges);
  ScanPointOptions options;
  ScanPoints points(options, 1081);
  points.assign(scan, {});
  const std::vector<ScanPoint>& thin = points.thinned();
  RC_ASSERT(!thin.empty());
  RC_ASSERT(static_cast<int>(thin.size()) <= options.thin_to);
  if (kind == 1) {
    RC_ASSERT(thin.size() > 200U);  // a room's 14 m of wall
  }
  auto from = points.all().begin();
  for (std::size_t i = 0; i < thin.size(); ++i) {
    from = std::find_if(from, points.all().end(),
                        [&](const ScanPoint& p) { return p.x == thin[i].x && p.y == thin[i].y; });
    RC_ASSERT(from != points.all().end());
    if (i > 0 && static_cast<int>(thin.size()) < options.thin_to) {
      RC_ASSERT(std::hypot(thin[i].x - thin[i - 1].x, thin[i].y - thin[i - 1].y) >= 0.999F * 0.025F);
    }
  }
}

}  // namespace
}  // namespace submapd
