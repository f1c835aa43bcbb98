// A relative pose with its covariance, and how both pass through ∘ and ⁻¹ to first order (design notes, section 1).
//
// The covariance is additive on the stored (x, y, yaw): for a_from_b it is expressed in a's frame; m^2, m rad, rad^2.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>

#include "slam/base/pose2.hpp"

namespace submapd::graph {

inline constexpr double kDegree = std::numbers::pi / 180.0;  // rad

// Standard deviations across a break: they fix the gauge and leave the rest to loops.
inline constexpr double kBreakM = 10.0;
inline constexpr double kBreakRad = 1.0;

struct UncertainPose {
  Pose2 mean;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

// Diagonal covariance of a standard deviation in metres for x and y, and one in radians for yaw.
[[nodiscard]] inline Eigen::Matrix3d pose_covariance(double sigma_m, double sigma_rad) {
  return Eigen::Vector3d(sigma_m * sigma_m, sigma_m * sigma_m, sigma_rad * sigma_rad).asDiagonal();
}

// a ∘ b for independent a and b: d(t)/d(θ_a) = S R_a t_b, d(t)/d(t_b) = R_a.
[[nodiscard]] inline UncertainPose compose(const UncertainPose& a, const UncertainPose& b) {
  const Eigen::Matrix2d R = rotation(a.mean.yaw);
  const Eigen::Vector2d turned = R * b.mean.translation();
  Eigen::Matrix3d J_a = Eigen::Matrix3d::Identity();
  J_a(0, 2) = -turned.y();
  J_a(1, 2) = turned.x();
  Eigen::Matrix3d J_b = Eigen::Matrix3d::Identity();
  J_b.topLeftCorner<2, 2>() = R;
  return {compose(a.mean, b.mean), J_a * a.covariance * J_a.transpose() + J_b * b.covariance * J_b.transpose()};
}

// a⁻¹ = (-Rᵀ t, -θ): d/dt = -Rᵀ, d/dθ = S Rᵀ t.
[[nodiscard]] inline UncertainPose inverse(const UncertainPose& a) {
  const Pose2 mean = inverse(a.mean);
  Eigen::Matrix3d J = Eigen::Matrix3d::Zero();
  J.topLeftCorner<2, 2>() = -rotation(-a.mean.yaw);
  J(0, 2) = mean.y;
  J(1, 2) = -mean.x;
  J(2, 2) = -1.0;
  return {mean, J * a.covariance * J.transpose()};
}

// Squared Mahalanobis distance of the pose `a` from zero: its yaw wrapped. Infinite if the covariance is not regular.
[[nodiscard]] inline double mahalanobis2(const Pose2& a, const Eigen::Matrix3d& covariance) {
  const Eigen::Vector3d e(a.x, a.y, wrap_angle(a.yaw));
  bool regular = false;
  Eigen::Matrix3d information;
  double determinant = 0.0;
  covariance.computeInverseAndDetWithCheck(information, determinant, regular, 1e-30);
  return regular ? e.dot(information * e) : std::numeric_limits<double>::infinity();
}

}  // namespace submapd::graph
