// Where the next scan is expected: constant body twist, or the motion u_t that odometry reports.
//
// Design notes, section 3 (twist and its Q) and 6.1. Stamps of recorded logs come in bursts and gaps, so the time step
// that counts in them is never shorter than the log's usual period.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "slam/base/pose2.hpp"

namespace submapd {

struct MotionModelOptions {
  double accel_sigma = 6.0;       // m/s^2, of an unknown push
  double yaw_accel_sigma = 16.0;  // rad/s^2
  double max_sigma_m = 0.6;       // Q saturates here: a cart does not teleport
  double max_sigma_rad = 0.5;
  double max_speed_m_s = 4.5;  // a twist beyond the cart's limits is not learnt
  double max_yaw_rate_rad_s = 4.0;
  double max_extrapolation_s = 1.0;  // beyond, the twist is worth nothing
  // Where stamps tell little of how long a step took, hardly any of the twist is worth using.
  double steady_s = 0.06;  // so long a cart goes on as it went ...
  double push_s = 0.2;     // ... and then it forgets its speed with this time constant
  double smoothing = 0.7;  // share of the newest twist
  // Odometry: sigma = base + share of the motion.
  double odom_base_m = 0.01;
  double odom_per_m = 0.10;
  double odom_m_per_rad = 0.05;
  double odom_base_rad = 0.01;
  double odom_rad_per_rad = 0.10;
  double odom_rad_per_m = 0.03;
};

// The usual period between scans, from the last of them: the median, or where many scans follow each other faster than
// a scanner turns, as those do that are stamped in bursts on arrival, the mean. Deterministic and bounded.
class PeriodEstimator {
 public:
  void add(double period_s);
  [[nodiscard]] double usual_s() const { return usual_s_; }
  [[nodiscard]] bool bursting() const { return bursting_; }

 private:
  static constexpr std::size_t kWindow = 101;
  std::array<double, kWindow> periods_{};
  std::size_t count_ = 0;
  double usual_s_ = 0.025;
  bool bursting_ = false;
};

// A motion in the body frame and the sigmas of its (x, y, yaw).
struct PredictedMotion {
  Pose2 delta;
  Eigen::Vector3d sigma = Eigen::Vector3d::Ones();
};

// What the cart's motion has lately been off from what was predicted: in slow logs, more than any model of pushes says.
// By the scan, smoothed; before kFewest of them it says nothing.
class PredictionError {
 public:
  void add(const Pose2& predicted_from_actual);
  // Of (x, y, yaw), m and rad, for a step of so many usual ones; the motion's own sigma where that is smaller.
  [[nodiscard]] Eigen::Vector3d sigma(const Eigen::Vector3d& of_motion, double steps) const;

 private:
  static constexpr int kFewest = 20;
  int count_ = 0;
  double square_m2_ = 0.0;
  double square_rad2_ = 0.0;
};

// REQUIRES: step_s > 0.
[[nodiscard]] PredictedMotion predict_by_twist(const Twist2& twist, double step_s, const MotionModelOptions& options);
// What of a step the twist is worth using for, where its time is not known well.
[[nodiscard]] double trusted_time_s(double step_s, const MotionModelOptions& options);
[[nodiscard]] PredictedMotion predict_by_odometry(const Pose2& delta, const MotionModelOptions& options);

// Twist of a matched motion, smoothed into `twist`; unchanged where the motion is beyond the cart's limits.
[[nodiscard]] Twist2 learn_twist(const Twist2& twist, const Pose2& delta, double step_s,
                                 const MotionModelOptions& options);

// Information matrix of a motion's end point, turned into the map frame.
[[nodiscard]] Eigen::Matrix3d motion_information(const PredictedMotion& motion, double yaw_rad);

}  // namespace submapd
