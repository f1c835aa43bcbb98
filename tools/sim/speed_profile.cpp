#include "tools/sim/speed_profile.hpp"

#include <algorithm>
#include <cmath>

namespace submapd::tools {

SpeedProfile::SpeedProfile(double length, double grid_step, const std::function<double(double)>& speed_limit,
                           const ProfileLimits& limits)
    : length_(length), window_s_(2.0 * limits.acceleration / limits.jerk) {
  const auto pieces = static_cast<std::size_t>(std::max(2.0, std::ceil(length / grid_step)));
  const double step = length / static_cast<double>(pieces);
  std::vector<double> own(pieces + 1);
  for (std::size_t i = 0; i <= pieces; ++i) {
    own[i] = speed_limit(step * static_cast<double>(i));
  }
  // Speed v at s holds as far as the cart gets within half a window around the moment it passes s.
  std::vector<double> speed = own;
  const double half = 0.5 * window_s_;
  for (std::size_t i = 0; i <= pieces; ++i) {
    const double reach = (own[i] + limits.acceleration * half) * half + limits.acceleration * half * half / 6.0;
    const auto cells = static_cast<std::size_t>(std::ceil(reach / step)) + 1;
    for (std::size_t k = i - std::min(i, cells); k <= std::min(pieces, i + cells); ++k) {
      speed[k] = std::min(speed[k], own[i]);
    }
  }
  speed.front() = speed.back() = 0.0;
  const double gain = 2.0 * limits.acceleration * step;  // v^2 over one step
  for (std::size_t i = 1; i <= pieces; ++i) {
    speed[i] = std::min(speed[i], std::sqrt(speed[i - 1] * speed[i - 1] + gain));
  }
  for (std::size_t i = pieces; i > 0; --i) {
    speed[i - 1] = std::min(speed[i - 1], std::sqrt(speed[i] * speed[i] + gain));
  }

  knots_.resize(pieces + 1);
  for (std::size_t i = 0; i <= pieces; ++i) {
    Knot& knot = knots_[i];
    knot.distance = step * static_cast<double>(i);
    knot.speed = speed[i];
    if (i == 0) {
      continue;
    }
    Knot& before = knots_[i - 1];
    const double duration = 2.0 * step / (before.speed + knot.speed);
    before.acceleration = (knot.speed - before.speed) / duration;
    knot.time_s = before.time_s + duration;
    knot.integral = before.integral + duration * (before.distance + duration * (before.speed / 2.0 +
                                                                                 duration * before.acceleration / 6.0));
  }
}

double SpeedProfile::integral(double time_s) const {
  if (time_s <= 0.0) {
    return 0.0;
  }
  const Knot& last = knots_.back();
  if (time_s >= last.time_s) {
    return last.integral + (time_s - last.time_s) * length_;
  }
  const auto after = std::upper_bound(knots_.begin(), knots_.end(), time_s,
                                      [](double time, const Knot& knot) { return time < knot.time_s; });
  const Knot& knot = *(after - 1);
  const double t = time_s - knot.time_s;
  return knot.integral + t * (knot.distance + t * (knot.speed / 2.0 + t * knot.acceleration / 6.0));
}

double SpeedProfile::distance(double time_s) const {
  return std::clamp((integral(time_s) - integral(time_s - window_s_)) / window_s_, 0.0, length_);
}

}  // namespace submapd::tools
