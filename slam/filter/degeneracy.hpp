// The latched degenerate state: a direction that no wall holds is not corrected by noise (design notes 5.4).
#pragma once

#include <Eigen/Core>
#include <array>

#include "slam/base/pose2.hpp"

namespace submapd {

struct DegeneracyOptions {
  double enter_ratio = 0.02;  // smaller to larger eigenvalue of the translation block, noise floor taken off
  double leave_ratio = 0.06;
  int leave_scans = 8;                // in a row
  double normal_noise_share = 0.005;  // of the trace: what normals off by 4 deg pretend to know
  double speed_sigma_m_s = 0.02;      // growth of the axial variance while latched
  double accel_sigma_m_s2 = 0.3;
  double min_associated = 40;  // points on surfaces, below which nothing is concluded
};

class DegeneracyMonitor {
 public:
  explicit DegeneracyMonitor(const DegeneracyOptions& options) : options_(options) {}

  // Looks at the line system H at the predicted pose (map frame). step_s: time since the last scan.
  void update(const Eigen::Matrix3d& information, int associated, double step_s);
  void reset();

  [[nodiscard]] bool active() const { return active_; }
  // Unit vector of the unobserved direction, map frame, while active.
  [[nodiscard]] const Eigen::Vector2d& axis() const { return axis_; }
  // Variance of the position along the axis gathered since it became unobservable [m^2].
  [[nodiscard]] double axial_variance_m2() const;
  [[nodiscard]] double time_s() const { return time_s_; }
  void change_frame(double yaw_rad);

 private:
  DegeneracyOptions options_;
  bool active_ = false;
  int good_scans_ = 0;
  double time_s_ = 0.0;  // since entry
  Eigen::Vector2d axis_ = Eigen::Vector2d::UnitX();
};

}  // namespace submapd
