// A smooth path through way-points, by arc length: where the simulated cart drives.
//
// The polyline is smoothed with a kernel of finite width (three box filters, so corners become curves of continuous
// curvature) and interpolated by a natural cubic spline with evenly spaced knots. Position and its first two derivatives are
// continuous; the parameter is arc length to about 1e-3.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace submapd::tools {

struct PathPoint {
  Eigen::Vector2d position;
  Eigen::Vector2d first;   // d/ds, of about unit length
  Eigen::Vector2d second;  // d2/ds2

  [[nodiscard]] double heading_rad() const;
  [[nodiscard]] double curvature() const;  // 1/m, left positive
};

class Path {
 public:
  // The curve leaves a 90 degree corner by about 0.28 * smoothing_m and has there a radius of about 0.47 * smoothing_m.
  // REQUIRES: at least two way-points that are not all the same; smoothing_m >= 0.
  Path(const std::vector<Eigen::Vector2d>& waypoints, double smoothing_m);

  [[nodiscard]] double length_m() const { return length_m_; }
  // REQUIRES: 0 <= s <= length, rounding aside.
  [[nodiscard]] PathPoint at(double s) const;

 private:
  double length_m_ = 0.0;
  double step_m_ = 0.0;
  std::vector<Eigen::Vector2d> knots_;
  std::vector<Eigen::Vector2d> second_;  // second derivative at each knot
};

// The polyline's points at even spacing close to step_m, both ends included.
[[nodiscard]] std::vector<Eigen::Vector2d> resample(const std::vector<Eigen::Vector2d>& polyline, double step_m);

}  // namespace submapd::tools
