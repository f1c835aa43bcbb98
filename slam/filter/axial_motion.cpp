#include "slam/filter/axial_motion.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr double kUnsteady = 0.5;  // mean square of the residuals in (careful) sigmas: beyond, the speed was not one
constexpr double kMapSigma_m = 0.003;   // no pose is better than the map
constexpr double kHangsBack_m = 0.015;  // the last beams that hold an axis would rather keep the cart where it was

}  // namespace

// Weighted line through positions over time: s = offset + speed t, t = 0 now.
struct AxialMotion::Line {
  double offset_m = 0.0;
  double speed_m_s = 0.0;
  double speed_variance = 0.0;
  double chi2 = 0.0;  // mean
};

void AxialMotion::reset() {
  noted_ = 0;
  start();
}

void AxialMotion::start() {
  const double speed_sigma = cold() ? options_.unknown_speed_sigma : options_.first_speed_sigma;
  covariance_ << options_.first_sigma_m * options_.first_sigma_m, 0.0, 0.0, speed_sigma * speed_sigma;
}

void AxialMotion::note_speed(double speed_m_s, double step_s) {
  since_standing_s_ = speed_m_s < options_.standing_m_s ? 0.0 : since_standing_s_ + step_s;
}

double AxialMotion::predict(double step_s, bool lost) {
  const double q = lost && !pushed() ? options_.lost_push_density : options_.push_density;
  const double t = step_s;
  Eigen::Matrix2d F;
  F << 1.0, t, 0.0, 1.0;
  Eigen::Matrix2d Q;
  Q << q * t * t * t / 3.0, q * t * t / 2.0, q * t * t / 2.0, q * t;
  covariance_ = F * covariance_ * F.transpose() + Q;
  return covariance_(0, 0);
}

void AxialMotion::update(double information) {
  const double noise = options_.kappa / std::max(information, 1e-9);
  const Eigen::Vector2d gain = covariance_.col(0) / (covariance_(0, 0) + noise);
  const Eigen::RowVector2d first = covariance_.row(0);
  covariance_ -= gain * first;
}

void AxialMotion::note(const Eigen::Vector2d& moved_m, double step_s, double information) {
  const bool weak = information > 0.0;
  const double of_map_m = weak ? kHangsBack_m : kMapSigma_m;
  const double of_beams_m2 = options_.kappa / (weak ? information : options_.strong_information);
  steps_[noted_ % steps_.size()] = {moved_m, step_s, of_beams_m2 + of_map_m * of_map_m};
  ++noted_;
}

AxialMotion::Line AxialMotion::fit(const Eigen::Vector2d& axis, std::size_t steps) const {
  double w = 0.0;
  double wt = 0.0;
  double ws = 0.0;
  double wtt = 0.0;
  double wts = 0.0;
  const auto each = [&](auto f) {
    double t = 0.0;
    double s = 0.0;
    for (std::size_t k = 0; k < steps; ++k) {
      const Step& step = back(k);
      f(t, s, 1.0 / step.variance_m2);
      t -= step.step_s;
      s -= axis.dot(step.moved_m);
    }
  };
  each([&](double t, double s, double weight) {
    w += weight;
    wt += weight * t;
    ws += weight * s;
    wtt += weight * t * t;
    wts += weight * t * s;
  });
  const double det = std::max(w * wtt - wt * wt, 1e-12);
  Line line;
  line.speed_m_s = (w * wts - wt * ws) / det;
  line.offset_m = (ws - line.speed_m_s * wt) / w;
  line.speed_variance = w / det;
  each([&](double t, double s, double weight) {
    const double off = s - line.offset_m - line.speed_m_s * t;
    line.chi2 += weight * off * off / static_cast<double>(steps);
  });
  return line;
}

AxialMotion::Steady AxialMotion::steady(const Eigen::Vector2d& axis) const {
  std::size_t steps = std::min(noted_, steps_.size());
  if (steps < kFewest) return {};
  Line line = fit(axis, steps);
  while (line.chi2 > kUnsteady && steps / 2 >= kFewest) {
    steps /= 2;
    line = fit(axis, steps);
  }
  return {line.speed_m_s, line.offset_m, std::sqrt(line.speed_variance)};
}

void AxialMotion::go_on(const Steady& steady) {
  const double sigma = std::hypot(steady.sigma_m_s, options_.lost_speed_sigma);
  covariance_ << options_.first_sigma_m * options_.first_sigma_m, 0.0, 0.0, sigma * sigma;
}

}  // namespace submapd
