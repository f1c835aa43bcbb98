// Travelled distance over time from rest to rest under limits of speed, acceleration and jerk.
//
// First the time-optimal profile under speed limits and |a| <= a_max (a forward and a backward pass over a grid of
// distances), then its moving average over a window T = 2 a_max / j_max in time. The average's acceleration is the mean of
// accelerations, its jerk the difference of two of them over T: |a| <= a_max, |j| <= j_max. The limits are widened by what
// the cart drives in T / 2 before the first step, so that the average keeps them too.
#pragma once

#include <functional>
#include <vector>

namespace submapd::tools {

struct ProfileLimits {
  double acceleration = 1.0;  // per s^2; the unit of distance is the caller's (m or rad)
  double jerk = 2.5;          // per s^3
};

class SpeedProfile {
 public:
  // speed_limit(s) > 0 for s in [0, length]. REQUIRES: length > 0, grid_step > 0, limits > 0.
  SpeedProfile(double length, double grid_step, const std::function<double(double)>& speed_limit,
               const ProfileLimits& limits);

  [[nodiscard]] double duration_s() const { return knots_.back().time_s + window_s_; }
  [[nodiscard]] double length() const { return length_; }
  // Distance at a time since the start; 0 before it and length after the end. Twice continuously differentiable.
  [[nodiscard]] double distance(double time_s) const;

 private:
  struct Knot {
    double time_s = 0.0;
    double distance = 0.0;
    double speed = 0.0;
    double acceleration = 0.0;  // until the next knot
    double integral = 0.0;      // of the distance over time up to here
  };
  [[nodiscard]] double integral(double time_s) const;

  double length_ = 0.0;
  double window_s_ = 0.0;
  std::vector<Knot> knots_;
};

}  // namespace submapd::tools
