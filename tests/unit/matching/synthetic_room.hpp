// Worlds of straight walls, exact ranges in them, and maps made from perfect poses: what the matchers are held against.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "slam/base/random.hpp"
#include "slam/grid/index_map.hpp"
#include "slam/matching/scan_points.hpp"

namespace submapd {

struct Wall {
  double x0, y0, x1, y1;
};
using World = std::vector<Wall>;

inline void add_box(World& world, double x0, double y0, double x1, double y1) {
  world.push_back({x0, y0, x1, y0});
  world.push_back({x1, y0, x1, y1});
  world.push_back({x1, y1, x0, y1});
  world.push_back({x0, y1, x0, y0});
}

// 8 m x 6 m with a cupboard, a table's side panel and a slanted board: nothing in it is symmetric.
inline World furnished_room() {
  World world;
  add_box(world, -4.03, -3.02, 3.97, 2.98);
  add_box(world, -3.2, 1.9, -2.1, 2.6);
  add_box(world, 2.02, -1.63, 2.41, -0.81);
  world.push_back({0.52, 2.11, 1.57, 1.34});
  return world;
}

// Distance along the ray to the closest wall; 0 if it hits none.
inline double cast(const World& world, double x, double y, double angle) {
  double best = 0.0;
  const double dx = std::cos(angle);
  const double dy = std::sin(angle);
  for (const Wall& w : world) {
    const double ex = w.x1 - w.x0;
    const double ey = w.y1 - w.y0;
    const double cross = dx * ey - dy * ex;
    if (std::abs(cross) < 1e-12) continue;
    const double t = ((w.x0 - x) * ey - (w.y0 - y) * ex) / cross;
    const double s = ((w.x0 - x) * dy - (w.y0 - y) * dx) / cross;
    if (t > 0.0 && s >= 0.0 && s <= 1.0 && (best == 0.0 || t < best)) best = t;
  }
  return best;
}

// The points of an instantaneous scan with ranges to the nanometre, where ScanPoints has millimetres.
inline std::vector<ScanPoint> exact_scan(const World& world, const Pose2& pose, int beams = 541) {
  std::vector<ScanPoint> points;
  for (int i = 0; i < beams; ++i) {
    const double angle = 1.5 * std::numbers::pi * (static_cast<double>(i) / (beams - 1) - 0.5);
    const double range = cast(world, pose.x, pose.y, pose.yaw + angle);
    if (range == 0.0) continue;
    ScanPoint p;
    p.x = static_cast<float>(range * std::cos(angle));
    p.y = static_cast<float>(range * std::sin(angle));
    p.view_x = static_cast<float>(-std::cos(angle));
    p.view_y = static_cast<float>(-std::sin(angle));
    p.range_m = static_cast<float>(range);
    points.push_back(p);
  }
  SurfaceNormals normals(points.size());
  normals.fill(points);
  return points;
}
inline constexpr double kExactStep_rad = 1.5 * std::numbers::pi / 540;

// A scan as the sensor gives it, 1081 beams over 270 deg in millimetres, with range noise.
inline Scan noisy_scan(const World& world, const Pose2& pose, double sigma_m, CounterRandom& random) {
  Scan scan;
  for (int i = 0; i < 1081; ++i) {
    const double angle = scan.geometry.first_angle_rad + i * scan.geometry.angle_step_rad;
    const double range = cast(world, pose.x, pose.y, pose.yaw + angle);
    const double mm = range == 0.0 ? 0.0 : 1e3 * (range + sigma_m * random.gaussian());
    scan.ranges_mm.push_back(static_cast<std::uint16_t>(std::clamp(std::lround(mm), 0L, 65535L)));
  }
  return scan;
}

// A map of the world from scans at known poses, with a distance field of its own.
struct RoomMap {
  RoomMap(const World& world, const std::vector<Pose2>& poses, double sigma_m = 0.0, std::uint64_t seed = 1) {
    insert(world, poses, poses, sigma_m, seed);
  }
  // Scans taken at the true poses, put where the believed ones say.
  void insert(const World& world, const std::vector<Pose2>& truth, const std::vector<Pose2>& believed, double sigma_m,
              std::uint64_t seed) {
    CounterRandom random(seed, 100, 0);
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const Pose2& pose = believed[i];
      const Scan scan = noisy_scan(world, truth[i], sigma_m, random);
      ScanPoints points({}, 1081);
      points.assign(scan, {});
      std::vector<BeamEnd> placed;
      placed.reserve(points.beams().size());
      const Eigen::Vector2f origin = place_beams(pose, points.beams(), Eigen::Vector2f::Zero(), placed);
      map.insert(origin, placed);
    }
  }
  [[nodiscard]] DistanceView field() const { return map.distance(); }

  DistanceLayers layers{400, 2};
  IndexMap map{IndexMapOptions{}, layers};
};

// Poses all over a room, to map it from.
inline std::vector<Pose2> tour(double half_x_m = 1.5, double half_y_m = 1.0) {
  std::vector<Pose2> poses;
  for (int i = 0; i < 24; ++i) {
    const double t = i * std::numbers::pi / 12.0;
    poses.push_back({half_x_m * std::cos(t), half_y_m * std::sin(2.0 * t), 1.3 * t});
  }
  return poses;
}

}  // namespace submapd
