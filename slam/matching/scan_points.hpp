// A scan as the matcher wants it: filtered, unwarped points in the base frame at the scan's stamp.
//
// Each beam is moved by the motion since the first beam, p_i' = Exp(xi tau_i) p_i (design notes, section 3): without it
// 3 m/s smears 5.6 cm over a sweep. Beams that are no measurement, too near, too far or mixed pixels are left out.
// Arrays are taken once for max_beams; filling them does not allocate.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/grid/free_space.hpp"
#include "slam/matching/scan_point.hpp"
#include "slam/matching/surface_normals.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

struct ScanPointOptions {
  int thin_to = 400;                // points that stage 1 and the searches use at most
  double min_spacing_m = 0.025;     // thinned points are at least this far apart
  double mixed_pixel_rad = 0.1396;  // 8 deg: flatter slopes to both neighbours are veils between surfaces
  bool error_code_is_free = false;  // sensor's code 1 means "nothing there up to the range limit"
};

class ScanPoints {
 public:
  ScanPoints(const ScanPointOptions& options, int max_beams);

  // Fills everything from a scan moving with body twist `twist`. Beams beyond max_beams are ignored.
  void assign(const Scan& scan, const Twist2& twist);
  // The same, but beams() and origin() alone, and those without normals.
  void assign_beams(const Scan& scan, const Twist2& twist);
  // The same scan under another twist. Normals stay: a sweep turns by less than they are known.
  // REQUIRES: assign(scan, ...) came last.
  void unwarp_again(const Scan& scan, const Twist2& twist);

  [[nodiscard]] const std::vector<ScanPoint>& all() const { return all_; }
  [[nodiscard]] const std::vector<ScanPoint>& thinned() const { return thinned_; }
  // Beam ends in order of angle for the map, base frame; beams without evidence have range 0.
  [[nodiscard]] const std::vector<BeamEnd>& beams() const { return beams_; }
  // Sensor position at mid-sweep, base frame at the stamp.
  [[nodiscard]] Eigen::Vector2f origin() const { return origin_; }
  // Root mean square and 95 % range of the points [m]; 0 without points.
  [[nodiscard]] double rms_range_m() const { return rms_range_m_; }
  [[nodiscard]] double far_range_m() const { return far_range_m_; }
  // Angle between neighbouring beams [rad], for the error model.
  [[nodiscard]] double angle_step_rad() const { return angle_step_rad_; }

 private:
  void update_table(const ScanGeometry& geometry, std::size_t beams);
  // Marks the first n beams that are a measurement, and those that are free but no hit.
  void filter(const Scan& scan, std::size_t n);
  void unwarp(const Scan& scan, const Twist2& twist);
  // All that follows from the points.
  void describe();
  // Weights, and the ranges over all points.
  void weigh();
  void mark_alone();
  void thin();

  ScanPointOptions options_;
  std::size_t max_beams_;
  std::vector<ScanPoint> all_;
  std::vector<ScanPoint> thinned_;
  std::vector<BeamEnd> beams_;
  std::vector<std::uint8_t> usable_;
  std::vector<float> ranges_scratch_;
  SurfaceNormals normals_;
  std::vector<Eigen::Vector2f> directions_;  // of the beams in the base frame, for table_geometry_
  ScanGeometry table_geometry_;
  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  double rms_range_m_ = 0.0;
  double far_range_m_ = 0.0;
  double angle_step_rad_ = 0.0;
};

}  // namespace submapd
