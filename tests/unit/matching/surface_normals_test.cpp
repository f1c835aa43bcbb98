#include "slam/matching/surface_normals.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd {
namespace {

constexpr double kStep_rad = std::numbers::pi / 720.0;

// What a scanner at the origin sees of the walls, each from one point to another, between two angles.
struct Wall {
  double x0;
  double y0;
  double x1;
  double y1;
};

std::vector<ScanPoint> scan_of(const std::vector<Wall>& walls, double from_rad, double to_rad, double sigma_m,
                               std::uint64_t seed = 1) {
  CounterRandom random(seed, 3, 4);
  std::vector<ScanPoint> points;
  for (double angle = from_rad; angle < to_rad; angle += kStep_rad) {
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    double range = 1e9;
    for (const Wall& w : walls) {
      const double dx = w.x1 - w.x0;
      const double dy = w.y1 - w.y0;
      const double det = c * dy - s * dx;
      const double r = (w.x0 * dy - w.y0 * dx) / det;
      const double t = (w.x0 * s - w.y0 * c) / det;
      if (r > 0.0 && t >= 0.0 && t <= 1.0) range = std::min(range, r);
    }
    if (range > 1e8) continue;
    range += sigma_m * random.gaussian();
    ScanPoint p;
    p.x = static_cast<float>(range * c);
    p.y = static_cast<float>(range * s);
    p.view_x = static_cast<float>(-c);
    p.view_y = static_cast<float>(-s);
    p.range_m = static_cast<float>(range);
    points.push_back(p);
  }
  return points;
}

bool known(const ScanPoint& p) {
  return p.normal_x != 0.0F || p.normal_y != 0.0F;
}

TEST(SurfaceNormalsTest, APlainWallAcrossNoise) {
  std::vector<ScanPoint> points = scan_of({{-3.0, 1.25, 3.0, 1.25}}, 0.4, 2.7, 0.01);
  SurfaceNormals normals(points.size());
  normals.fill(points);
  double square = 0.0;
  int count = 0;
  for (const ScanPoint& p : points) {
    if (!known(p)) continue;
    ++count;
    EXPECT_NEAR(std::hypot(p.normal_x, p.normal_y), 1.0F, 1e-4F);
    EXPECT_LT(p.normal_y, 0.0F) << "towards the sensor";
    square += std::pow(std::atan2(static_cast<double>(p.normal_x), static_cast<double>(-p.normal_y)), 2);
  }
  EXPECT_GT(count, static_cast<int>(0.95 * static_cast<double>(points.size())));
  EXPECT_LT(std::sqrt(square / count), 0.2);
}

// A wall, a jamb of 12 cm that faces the sensor, the door behind it: each point but those at the edges is told its own.
TEST(SurfaceNormalsTest, AJambIsTheSameToABeamOrTwo) {
  const std::vector<Wall> walls{{1.0, 1.25, 3.0, 1.37}, {3.0, 1.37, 3.0, 1.25}, {3.0, 1.25, 6.0, 1.25}};
  std::vector<ScanPoint> points = scan_of({{1.0, 1.37, 3.0, 1.37}, walls[1], walls[2]}, 0.25, 0.9, 0.003);
  SurfaceNormals normals(points.size());
  normals.fill(points);
  int of_jamb = 0;
  int right = 0;
  for (const ScanPoint& p : points) {
    const bool on_jamb = std::abs(p.x - 3.0F) < 0.015F && p.y > 1.25F && p.y < 1.365F;
    if (!on_jamb) continue;
    ++of_jamb;
    right += p.normal_x < -0.9F ? 1 : 0;
  }
  EXPECT_GE(of_jamb, 4);
  EXPECT_GE(right, of_jamb - 2);
  int of_walls = 0;
  int along = 0;
  for (const ScanPoint& p : points) {
    if (std::abs(p.x - 3.0F) < 0.03F || !known(p)) continue;
    ++of_walls;
    along += p.normal_y < -0.9F ? 1 : 0;
  }
  EXPECT_GT(of_walls, 100);
  EXPECT_GT(along, static_cast<int>(0.97 * of_walls));
}

TEST(SurfaceNormalsTest, AGapEndsAWindow) {
  // Two walls, one a metre behind the other: no line leads from one to the other.
  std::vector<ScanPoint> points = scan_of({{-2.0, 2.0, 0.0, 2.0}, {-2.0, 3.0, 2.0, 3.0}}, 1.2, 2.0, 0.0);
  SurfaceNormals normals(points.size());
  normals.fill(points);
  for (const ScanPoint& p : points) {
    ASSERT_TRUE(known(p));
    EXPECT_LT(p.normal_y, -0.999F) << p.x << " " << p.y;
  }
}

TEST(SurfaceNormalsTest, TooFewOrTooScatteredSayNothing) {
  SurfaceNormals normals(100);
  std::vector<ScanPoint> none;
  normals.fill(none);
  for (const std::size_t n : {std::size_t{1}, std::size_t{2}}) {
    std::vector<ScanPoint> few(n);
    for (std::size_t i = 0; i < n; ++i) few[i].x = 0.02F * static_cast<float>(i);
    normals.fill(few);
    for (const ScanPoint& p : few) EXPECT_FALSE(known(p));
  }
  std::vector<ScanPoint> far(20);  // 30 cm from one another
  for (std::size_t i = 0; i < far.size(); ++i) {
    far[i].x = 0.3F * static_cast<float>(i);
    far[i].y = 1.0F;
    far[i].view_y = -1.0F;
  }
  normals.fill(far);
  for (const ScanPoint& p : far) EXPECT_FALSE(known(p));
}

RC_GTEST_PROP(SurfaceNormalsTest, UnitAndTowardsTheSensorOrNone, ()) {
  const auto count = *rc::gen::inRange<std::size_t>(0, 200);
  std::vector<ScanPoint> points(count);
  for (ScanPoint& p : points) {
    p.x = static_cast<float>(*rc::gen::inRange(-300, 300)) * 0.01F;
    p.y = static_cast<float>(*rc::gen::inRange(-300, 300)) * 0.01F;
    const float range = std::hypot(p.x, p.y) + 1e-3F;
    p.view_x = -p.x / range;
    p.view_y = -p.y / range;
  }
  SurfaceNormals normals(count);
  normals.fill(points);
  for (const ScanPoint& p : points) {
    if (!known(p)) continue;
    RC_ASSERT(std::abs(std::hypot(p.normal_x, p.normal_y) - 1.0F) < 1e-3F);
    RC_ASSERT(p.normal_x * p.view_x + p.normal_y * p.view_y > 0.0F);
  }
}

}  // namespace
}  // namespace submapd
