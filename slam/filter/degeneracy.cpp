#include "slam/filter/degeneracy.hpp"

#include "slam/base/small_matrix.hpp"

namespace submapd {

void DegeneracyMonitor::reset() {
  active_ = false;
  good_scans_ = 0;
  time_s_ = 0.0;
}

void DegeneracyMonitor::update(const Eigen::Matrix3d& information, int associated, double step_s) {
  if (active_) time_s_ += step_s;
  if (associated < options_.min_associated) return;
  const Eigen::Matrix2d block = information.topLeftCorner<2, 2>();
  const PrincipalAxes<2> principal = principal_axes(block);
  const double floor = options_.normal_noise_share * block.trace();
  const double low = std::max(principal.values(0) - floor, 0.0);
  const double high = std::max(principal.values(1) - floor, 1e-9);
  const double ratio = low / high;
  if (!active_) {
    if (ratio < options_.enter_ratio) {
      active_ = true;
      good_scans_ = 0;
      time_s_ = 0.0;
      axis_ = principal.axes.col(0);
    }
    return;
  }
  good_scans_ = ratio > options_.leave_ratio ? good_scans_ + 1 : 0;
  if (ratio < options_.enter_ratio) axis_ = principal.axes.col(0);
  if (good_scans_ >= options_.leave_scans) reset();
}

double DegeneracyMonitor::axial_variance_m2() const {
  const double by_speed = options_.speed_sigma_m_s * time_s_;
  const double by_accel = 0.5 * options_.accel_sigma_m_s2 * time_s_ * time_s_;
  return by_speed * by_speed + by_accel * by_accel;
}

void DegeneracyMonitor::change_frame(double yaw_rad) {
  axis_ = rotation(yaw_rad) * axis_;
}

}  // namespace submapd
