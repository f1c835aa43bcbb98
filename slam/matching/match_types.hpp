// What the stages of the scan matcher exchange.
#pragma once

#include <Eigen/Core>

#include "slam/base/pose2.hpp"

namespace submapd {

// A motion of the cart that few walls hold: along `axis` (unit vector, map frame), turning by turn_rad_m as it goes. Of
// a straight corridor the turn is 0, of a round one the inverse of its radius. Without axis: none.
struct WeakMotion {
  Eigen::Vector2d axis = Eigen::Vector2d::Zero();
  double turn_rad_m = 0.0;

  [[nodiscard]] bool any() const { return axis.squaredNorm() > 0.0; }
  // A pose so far on along it.
  [[nodiscard]] Pose2 moved(const Pose2& pose, double along_m) const {
    return {pose.x + along_m * axis.x(), pose.y + along_m * axis.y(), pose.yaw + along_m * turn_rad_m};
  }
};

// Where the motion model expects the scan, and how firmly: covariance Q in the map frame (x, y, yaw), as information.
struct MotionPrior {
  Pose2 pose;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  // Along it the field does not count, and of the surfaces only those that face it: a thousand normals that are off by
  // some degrees outweigh ten honest beams.
  WeakMotion weak;
};

// Health of one scan against the map (design notes 5.5).
struct MatchHealth {
  double matched_ratio = 0.0;    // share of points with the field below its limit
  double mean_distance_m = 0.0;  // of the matched points to the closest obstacle
  double line_ratio = 0.0;       // share of points that found a surface in stage 2
  double contradiction = 0.0;    // share of points deep inside known free space
  int iterations = 0;
};

struct MatchResult {
  Pose2 pose;                                             // in the map frame
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // of the measurement alone, H of the last pass, not inflated
  MatchHealth health;
};

// One Gauss-Newton system in (x, y, yaw).
struct NormalEquations {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();

  void add(double jx, double jy, double jw, double residual, double weight) {
    H(0, 0) += weight * jx * jx;
    H(0, 1) += weight * jx * jy;
    H(0, 2) += weight * jx * jw;
    H(1, 1) += weight * jy * jy;
    H(1, 2) += weight * jy * jw;
    H(2, 2) += weight * jw * jw;
    g(0) += weight * jx * residual;
    g(1) += weight * jy * residual;
    g(2) += weight * jw * residual;
  }
  void complete() {
    H(1, 0) = H(0, 1);
    H(2, 0) = H(0, 2);
    H(2, 1) = H(1, 2);
  }
};

// Step of (H / kappa + Q^-1) delta = -(g / kappa + Q^-1 (x - x_pred)).
[[nodiscard]] Eigen::Vector3d solve_step(const NormalEquations& equations, double kappa, const Pose2& pose,
                                         const MotionPrior& prior);

}  // namespace submapd
