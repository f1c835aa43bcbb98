#include "slam/filter/motion_model.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "slam/base/small_matrix.hpp"

namespace submapd {
namespace {

constexpr std::size_t kPauses = 5;        // so many of the window may be gaps, which say nothing of the others
constexpr double kBurst = 0.25;           // of the mean: faster than a scanner turns
constexpr double kBursts = 0.1;           // share of such periods
constexpr double kFastestTurn_s = 0.004;  // of a scanner

constexpr double kNewest = 0.03;   // share of the newest scan's error in the mean square
constexpr double kCautious = 2.0;  // a scan may be off by more than scans usually are

}  // namespace

void PeriodEstimator::add(double period_s) {
  if (!(period_s > 0.0)) return;
  if (count_ == 0 && period_s < kFastestTurn_s) return;  // a log that begins with a burst
  periods_[count_ % kWindow] = period_s;
  ++count_;
  std::array<double, kWindow> sorted{};
  const std::size_t n = std::min(count_, kWindow);
  const auto end = std::copy_n(periods_.begin(), n, sorted.begin());
  std::sort(sorted.begin(), end);
  const std::size_t counted = n - (n == kWindow ? kPauses : 0);
  const double mean_s = std::accumulate(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(counted), 0.0) /
                        static_cast<double>(counted);
  const auto hurried = std::lower_bound(sorted.begin(), end, kBurst * mean_s) - sorted.begin();
  bursting_ = static_cast<double>(hurried) > kBursts * static_cast<double>(n);
  usual_s_ = bursting_ ? mean_s : sorted[n / 2];
}

void PredictionError::add(const Pose2& predicted_from_actual) {
  const Pose2& d = predicted_from_actual;
  ++count_;
  const double share = std::max(kNewest, 1.0 / count_);
  square_m2_ += share * (0.5 * (d.x * d.x + d.y * d.y) - square_m2_);
  square_rad2_ += share * (d.yaw * d.yaw - square_rad2_);
}

Eigen::Vector3d PredictionError::sigma(const Eigen::Vector3d& of_motion, double steps) const {
  if (count_ < kFewest) return of_motion;
  const double m = kCautious * steps * std::sqrt(square_m2_);
  return of_motion.cwiseMin(Eigen::Vector3d(m, m, kCautious * steps * std::sqrt(square_rad2_)));
}

PredictedMotion predict_by_twist(const Twist2& twist, double step_s, const MotionModelOptions& options) {
  PredictedMotion motion;
  motion.delta = exp_twist(twist, std::min(step_s, options.max_extrapolation_s));
  const double half_square = 0.5 * step_s * step_s;
  const double sigma_m = std::min(options.accel_sigma * half_square, options.max_sigma_m);
  motion.sigma = {sigma_m, sigma_m, std::min(options.yaw_accel_sigma * half_square, options.max_sigma_rad)};
  return motion;
}

double trusted_time_s(double step_s, const MotionModelOptions& options) {
  const double later_s = std::max(step_s - options.steady_s, 0.0);
  return std::min(step_s, options.steady_s) + options.push_s * -std::expm1(-later_s / options.push_s);
}

PredictedMotion predict_by_odometry(const Pose2& delta, const MotionModelOptions& options) {
  PredictedMotion motion;
  motion.delta = delta;
  const double d = std::hypot(delta.x, delta.y);
  const double a = std::abs(delta.yaw);
  const double sigma_m = options.odom_base_m + options.odom_per_m * d + options.odom_m_per_rad * a;
  motion.sigma = {sigma_m, sigma_m, options.odom_base_rad + options.odom_rad_per_rad * a + options.odom_rad_per_m * d};
  return motion;
}

Twist2 learn_twist(const Twist2& twist, const Pose2& delta, double step_s, const MotionModelOptions& options) {
  const Twist2 fresh = log_pose(delta, step_s);
  if (std::hypot(fresh.vx, fresh.vy) > options.max_speed_m_s || std::abs(fresh.wz) > options.max_yaw_rate_rad_s) {
    return twist;
  }
  const double a = options.smoothing;
  return {a * fresh.vx + (1.0 - a) * twist.vx, a * fresh.vy + (1.0 - a) * twist.vy,
          a * fresh.wz + (1.0 - a) * twist.wz};
}

Eigen::Matrix3d motion_information(const PredictedMotion& motion, double yaw_rad) {
  const Eigen::Vector3d weights = motion.sigma.array().square().inverse();
  return turned(weights.asDiagonal(), yaw_rad);
}

}  // namespace submapd
