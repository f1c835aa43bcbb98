// SE(2): poses, body twists, exponential and logarithm (design notes, section 1).
//
// Metres, radians, x forward, y left, counter-clockwise positive. A Pose2 named a_from_b maps coordinates of frame b
// into frame a and is the pose of b in a. Yaw is not wrapped by compose(): wrap residuals, not stored angles.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>

namespace submapd {

struct Pose2 {
  double x = 0.0;    // m
  double y = 0.0;    // m
  double yaw = 0.0;  // rad

  [[nodiscard]] Eigen::Vector2d translation() const { return {x, y}; }
  friend bool operator==(const Pose2&, const Pose2&) = default;
};

// Body velocity.
struct Twist2 {
  double vx = 0.0;  // m/s, forward
  double vy = 0.0;  // m/s, left
  double wz = 0.0;  // rad/s
  friend bool operator==(const Twist2&, const Twist2&) = default;
};

// Angle to [-pi, pi); NaN for what is not finite.
[[nodiscard]] inline double wrap_angle(double angle_rad) {
  const double turned = angle_rad + std::numbers::pi;
  const double wrapped = turned - 2.0 * std::numbers::pi * std::floor(turned / (2.0 * std::numbers::pi));
  if (wrapped >= 0.0 && wrapped < 2.0 * std::numbers::pi) return wrapped - std::numbers::pi;
  // Rounding led out of the interval: just below a multiple of 2 pi, or many turns away. The slow way is exact.
  const double rest = std::remainder(angle_rad, 2.0 * std::numbers::pi);
  return rest >= std::numbers::pi ? -std::numbers::pi : rest;
}

// a ∘ b = (t_a + R_a t_b, θ_a + θ_b).
[[nodiscard]] inline Pose2 compose(const Pose2& a, const Pose2& b) {
  const double c = std::cos(a.yaw);
  const double s = std::sin(a.yaw);
  return {a.x + c * b.x - s * b.y, a.y + s * b.x + c * b.y, a.yaw + b.yaw};
}

[[nodiscard]] inline Pose2 inverse(const Pose2& a) {
  const double c = std::cos(a.yaw);
  const double s = std::sin(a.yaw);
  return {-(c * a.x + s * a.y), s * a.x - c * a.y, -a.yaw};
}

// a⁻¹ ∘ b: the pose of b seen from a, its yaw wrapped.
[[nodiscard]] inline Pose2 between(const Pose2& a, const Pose2& b) {
  const double c = std::cos(a.yaw);
  const double s = std::sin(a.yaw);
  const double dx = b.x - a.x;
  const double dy = b.y - a.y;
  return {c * dx + s * dy, -s * dx + c * dy, wrap_angle(b.yaw - a.yaw)};
}

[[nodiscard]] inline Eigen::Vector2d transform(const Pose2& a, const Eigen::Vector2d& p) {
  const double c = std::cos(a.yaw);
  const double s = std::sin(a.yaw);
  return {a.x + c * p.x() - s * p.y(), a.y + s * p.x() + c * p.y()};
}

[[nodiscard]] inline Eigen::Matrix2d rotation(double yaw_rad) {
  const double c = std::cos(yaw_rad);
  const double s = std::sin(yaw_rad);
  return (Eigen::Matrix2d() << c, -s, s, c).finished();
}

// Pose reached after moving for duration_s with the constant body twist xi.
[[nodiscard]] inline Pose2 exp_twist(const Twist2& xi, double duration_s) {
  const double phi = xi.wz * duration_s;
  double a = 1.0 - phi * phi / 6.0;
  double b = phi / 2.0 - phi * phi * phi / 24.0;
  if (std::abs(phi) >= 1e-4) {
    a = std::sin(phi) / phi;
    b = (1.0 - std::cos(phi)) / phi;
  }
  const double dx = xi.vx * duration_s;
  const double dy = xi.vy * duration_s;
  return {a * dx - b * dy, b * dx + a * dy, phi};
}

// The constant body twist that reaches pose after duration_s; inverse of exp_twist for |yaw| < pi.
// REQUIRES: duration_s > 0.
[[nodiscard]] inline Twist2 log_pose(const Pose2& pose, double duration_s) {
  const double phi = wrap_angle(pose.yaw);
  const double half = phi / 2.0;
  const double k = std::abs(phi) < 1e-4 ? 1.0 - phi * phi / 12.0 : half / std::tan(half);
  return {(k * pose.x + half * pose.y) / duration_s, (-half * pose.x + k * pose.y) / duration_s, phi / duration_s};
}

// The pose a share s in [0, 1] of the way from a to b along the constant twist between them.
[[nodiscard]] inline Pose2 interpolate(const Pose2& a, const Pose2& b, double s) {
  return compose(a, exp_twist(log_pose(between(a, b), 1.0), s));
}

}  // namespace submapd
