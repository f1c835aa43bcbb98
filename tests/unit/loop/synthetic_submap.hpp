// Finished sub-maps for tests: a few walls, ray cast from known poses, counted into cells and surface statistics.
//
// The map is built at the true poses, so what a test finds is the error of what it tests, plus the scanner's noise.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd::testing {

struct Wall {
  Eigen::Vector2d from;
  Eigen::Vector2d to;
};

struct World {
  std::vector<Wall> walls;
  World& wall(double x0, double y0, double x1, double y1);
  World& box(double x0, double y0, double x1, double y1);
};

struct SyntheticSensor {
  int beams = 1081;
  ScanGeometry geometry;
  double noise_m = 0.012;
  double quantum_m = 0.001;
  // A UTM-30LX: 270 deg in quarter degrees.
  [[nodiscard]] static SyntheticSensor dense();
  // A SICK LMS: 180 deg in whole degrees, whole centimetres.
  [[nodiscard]] static SyntheticSensor sparse();
};

// A scan at a true pose, as the scanner would take it.
struct TruePose {
  std::uint64_t scan_index = 0;
  Pose2 world_from_base;
  Twist2 twist;
};

// Poses along way-points, one every step_m, heading along the way, turning on the spot in 20 deg steps.
[[nodiscard]] std::vector<TruePose> walk(const std::vector<Eigen::Vector2d>& way, double step_m,
                                         std::uint64_t first_scan, const Twist2& twist = {});

struct SyntheticOptions {
  SyntheticSensor sensor = SyntheticSensor::dense();
  std::uint32_t index = 0;
  std::uint64_t seed = 1;
  double carve_limit_m = 15.0;
};

// The sub-map of these key-frames; its frame is the first one's pose. Noise depends on seed, scan and beam only, so two
// sub-maps that share a key-frame share its scan.
[[nodiscard]] FinishedSubmap make_submap(const World& world, const std::vector<TruePose>& path,
                                         const SyntheticOptions& options);

// 20 x 15 m of offices: rooms, doors, cabinets; and a tour of about 30 m through them.
[[nodiscard]] World office();
[[nodiscard]] std::vector<Eigen::Vector2d> office_tour();

}  // namespace submapd::testing
