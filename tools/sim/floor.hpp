// A floor that is not level: how a cart on it tilts its scanner, and where a tilted beam meets floor or ceiling.
//
// The height depends on x only, piecewise linear: ramps and door sills across x. Metres. Immutable.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"

namespace submapd::tools {

class Floor {
 public:
  // Knots (x, height) in ascending order of x; beyond both ends the floor is level. REQUIRES: at least one knot.
  explicit Floor(std::vector<Eigen::Vector2d> knots) : knots_(std::move(knots)) {}

  [[nodiscard]] double height_m(double x) const;

  // Unit vector of a beam at an angle from the nose of a cart with its wheels on this floor: x, y in the world, z up.
  [[nodiscard]] Eigen::Vector3d beam(const Pose2& world_from_base, double angle_rad) const;

  // Way in the plan until a beam of the scanner at `origin` meets floor or ceiling. rise: its height gained a metre of
  // that way. Nothing if it meets neither within limit_m.
  [[nodiscard]] std::optional<double> meet(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction, double rise,
                                           double limit_m) const;

 private:
  std::vector<Eigen::Vector2d> knots_;
};

}  // namespace submapd::tools
