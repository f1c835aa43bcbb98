#include "slam/filter/degeneracy.hpp"

#include <algorithm>
#include <cmath>

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

DegeneracyMonitor::Weakness DegeneracyMonitor::weakness(const Eigen::Matrix2d& block) const {
  const PrincipalAxes<2> principal = principal_axes(block);
  const double floor = options_.normal_noise_share * block.trace();
  const double low = std::max(principal.values(0) - floor, 0.0);
  const double high = std::max(principal.values(1) - floor, 1e-9);
  return {low / high, principal.axes.col(0)};
}

void DegeneracyMonitor::update(const Eigen::Matrix3d& information, int associated, double step_s) {
  if (active_) time_s_ += step_s;
  if (associated < options_.min_associated) return;
  const Eigen::Matrix2d block = information.topLeftCorner<2, 2>();
  Weakness found = weakness(block);
  double turn_rad_m = 0.0;
  if (found.ratio >= options_.round_ratio) {
    // Round corridors: every wall holds the cart's way straight ahead, none its way round.
    const Eigen::Vector2d cross = information.topRightCorner<2, 1>();
    const double of_yaw = std::max(information(2, 2), 1e-9);
    const Weakness round = weakness(block - cross * cross.transpose() / of_yaw);
    const double turn = -cross.dot(round.axis) / of_yaw;
    if (round.ratio < options_.round_ratio && std::abs(turn) > options_.least_turn_rad_m) {
      found = round;
      turn_rad_m = turn;
    }
  }
  const double ratio = found.ratio;
  if (ratio < options_.enter_ratio) {
    axis_ = found.axis;
    turn_rad_m_ = turn_rad_m;
  }
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
