#include "slam/filter/degeneracy.hpp"

#include "slam/base/small_matrix.hpp"

namespace submapd {

void DegeneracyMonitor::reset() {
  weak_ = false;
  active_ = false;
  good_scans_ = 0;
  held_scans_ = 0;
  loose_scans_ = 0;
  axial_information_ = 0.0;
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
  if (ratio < options_.enter_ratio) axis_ = principal.axes.col(0);
  if (!weak_) {
    weak_ = ratio < options_.enter_ratio;
    good_scans_ = 0;
    return;
  }
  good_scans_ = ratio > options_.leave_ratio ? good_scans_ + 1 : 0;
  if (good_scans_ >= options_.leave_scans) reset();
}

void DegeneracyMonitor::hold(double axial_information) {
  axial_information_ = axial_information;
  const double variance_m2 = options_.kappa / std::max(axial_information, 1e-9);
  held_scans_ = variance_m2 < options_.found_sigma_m * options_.found_sigma_m ? held_scans_ + 1 : 0;
  loose_scans_ = variance_m2 > options_.lost_sigma_m * options_.lost_sigma_m ? loose_scans_ + 1 : 0;
  if (!active_ && loose_scans_ >= options_.lost_scans) {
    active_ = true;
    time_s_ = 0.0;
  } else if (active_ && held_scans_ >= options_.leave_scans) {
    active_ = false;
    time_s_ = 0.0;
  }
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
