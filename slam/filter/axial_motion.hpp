// Speed along a direction that few beams or none hold (design notes 5.4).
//
// Two estimates of the same motion. While few beams hold the axis: a Kalman filter over (position, speed) along it, so
// that a dozen beams teach a new speed within a few scans and their noise does not. When nothing holds it any longer:
// the speed of the longest steady stretch of the last second, which no single scan on the way out of sight can spoil;
// the cart then goes on with that. One thread, does not allocate.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

namespace submapd {

struct AxialMotionOptions {
  double push_density = 0.4;         // m^2/s^3, of white acceleration: 1 m/s^2 for half a second
  double lost_push_density = 0.05;   // while nothing holds the axis: few beams more likely err than the cart is pushed
  double pushed_s = 2.0;             // ... but for a cart that stood so long ago: it was pushed off ...
  double standing_m_s = 0.3;         // ... and is, until it goes faster
  double lost_speed_sigma = 0.02;    // m/s, at least, when that begins
  double first_sigma_m = 0.003;      // of a pose that walls all around held
  double first_speed_sigma = 0.05;   // m/s, of a cart that was tracked so far ...
  double unknown_speed_sigma = 1.5;  // ... and of one that was not
  double strong_information = 1e5;   // 1/m^2, of a scan that walls all around held
  double kappa = 2.0;                // neighbouring beams are correlated: sigma^2 = kappa / information
};

class AxialMotion {
 public:
  explicit AxialMotion(const AxialMotionOptions& options) : options_(options) {}

  // Nothing is known: a new track.
  void reset();
  // No speed has been seen yet.
  [[nodiscard]] bool cold() const { return noted_ < kFewest; }
  // The axis becomes weak: the filter starts from a well held pose.
  void start();

  // Each scan, weak axis or not: the cart's speed.
  void note_speed(double speed_m_s, double step_s);
  // It stands or has just set off: its speed is anything.
  [[nodiscard]] bool pushed() const { return since_standing_s_ < options_.pushed_s; }
  // Time passes; lost: nothing holds the axis. Returns the variance of the predicted position along the axis [m^2].
  double predict(double step_s, bool lost);
  // Beams with this information [1/m^2] were used.
  void update(double information);
  // Change of speed [m/s] that belongs to a correction [m] of the predicted position.
  [[nodiscard]] double speed_gain() const { return covariance_(0, 1) / covariance_(0, 0); }

  // The matched motion of one scan, body frame, and what held it along the weak axis; 0: all around.
  void note(const Eigen::Vector2d& moved_m, double step_s, double information);

  // Of the longest steady stretch within the last second, at its end; `axis` is a unit vector in the body frame: a cart
  // that turns keeps its speed ahead.
  struct Steady {
    double speed_m_s = 0.0;
    double offset_m = 0.0;  // where the fitted line is now, relative to the last pose
    double sigma_m_s = 0.0;
  };
  [[nodiscard]] Steady steady(const Eigen::Vector2d& axis) const;
  // Nothing holds the axis from here on: the speed is this one.
  void go_on(const Steady& steady);

 private:
  static constexpr std::size_t kFewest = 6;  // steps that make a stretch
  struct Step {
    Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();
    double step_s = 0.0;
    double variance_m2 = 0.0;
  };
  struct Line;
  [[nodiscard]] Line fit(const Eigen::Vector2d& axis, std::size_t steps) const;
  // k = 0: the newest.
  [[nodiscard]] const Step& back(std::size_t k) const { return steps_[(noted_ - 1 - k) % steps_.size()]; }

  AxialMotionOptions options_;
  Eigen::Matrix2d covariance_ = Eigen::Matrix2d::Identity();
  std::array<Step, 40> steps_;
  std::size_t noted_ = 0;
  double since_standing_s_ = 1e9;
};

}  // namespace submapd
