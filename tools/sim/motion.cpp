#include "tools/sim/motion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

constexpr double kProfileStep_m = 0.05;
constexpr double kProfileStep_rad = 0.02;
constexpr double kReversal_rad = 2.0 * std::numbers::pi / 3.0;  // a sharper bend is a turn on the spot
constexpr double kPause_s = 0.2;                                // between driving and turning
constexpr double kMinLeg_m = 0.3;
constexpr double kWobbleLength_m[2] = {3.1, 1.3};
constexpr double kWobbleShare[2] = {0.7, 0.3};
constexpr double kWobbleRamp_m = 1.5;
constexpr double kSlowest_m_s = 0.02;

// Random streams; the way-points use theirs with the number of the way-point.
constexpr std::uint64_t kJitterStream = 0x4A495454;
constexpr std::uint64_t kWobbleStream = 0x574F4242;
constexpr std::uint64_t kStopStream = 0x53544F50;

constexpr double kCadence_rad_s = 2.0 * std::numbers::pi * 1.9;
constexpr double kStopMargin_m = 1.2;  // no stop nearer than this to a way-point

constexpr double kMostLaps = 1e5;

// 0 at 0, 1 from 1 on, twice continuously differentiable; steepest slope 1.875.
double smootherstep(double u) {
  u = std::clamp(u, 0.0, 1.0);
  return u * u * u * (10.0 + u * (6.0 * u - 15.0));
}

double ramp_length(double length_m) {
  return std::min(kWobbleRamp_m, length_m / 3.0);
}

std::vector<Eigen::Vector2d> lay_out_laps(const Route& route, const MotionOptions& options) {
  double lap_m = route.closed ? (route.waypoints.front() - route.waypoints.back()).norm() : 0.0;
  for (std::size_t i = 1; i < route.waypoints.size(); ++i) {
    lap_m += (route.waypoints[i] - route.waypoints[i - 1]).norm();
  }
  // A way without length is refused later; it must not have infinitely many laps before.
  const bool repeats = options.duration_s > 0.0 && lap_m > 0.0;
  const double laps =
      repeats ? std::clamp(std::ceil(options.duration_s * options.speed_m_s / lap_m), 0.0, kMostLaps) : 1.0;
  std::vector<Eigen::Vector2d> points;
  const auto add = [&](const Eigen::Vector2d& waypoint) {
    CounterRandom random(options.seed, kJitterStream, points.size());
    const double x = random.uniform(-route.jitter_m, route.jitter_m);
    const double y = random.uniform(-route.jitter_m, route.jitter_m);
    points.emplace_back(waypoint.x() + x, waypoint.y() + y);
  };
  for (std::size_t lap = 0; lap < static_cast<std::size_t>(laps); ++lap) {
    const bool back = !route.closed && lap % 2 == 1;
    for (std::size_t i = 0; i < route.waypoints.size(); ++i) {
      if (!route.closed && lap > 0 && i == 0) {
        continue;  // this end of the way is there already
      }
      add(route.waypoints[back ? route.waypoints.size() - 1 - i : i]);
    }
  }
  if (route.closed) {
    add(route.waypoints.front());
  }
  points.erase(std::unique(points.begin(), points.end(),
                           [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return (a - b).norm() < 1e-3; }),
               points.end());
  return points;
}

std::vector<std::vector<Eigen::Vector2d>> split_at_reversals(const std::vector<Eigen::Vector2d>& points) {
  std::vector<std::vector<Eigen::Vector2d>> legs(1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    legs.back().push_back(points[i]);
    if (i == 0 || i + 1 == points.size()) {
      continue;
    }
    const Eigen::Vector2d in = (points[i] - points[i - 1]).normalized();
    const Eigen::Vector2d out = (points[i + 1] - points[i]).normalized();
    if (in.dot(out) < std::cos(kReversal_rad)) {
      legs.push_back({points[i]});
    }
  }
  return legs;
}

}  // namespace

Expected<Motion> Motion::along(const Route& route, const MotionOptions& options) {
  const bool positive = options.speed_m_s >= 0.05 && options.acceleration_m_s2 > 0.0 && options.jerk_m_s3 > 0.0 &&
                        options.lateral_acceleration_m_s2 > 0.0 && options.yaw_rate_rad_s > 0.0 &&
                        options.yaw_acceleration_rad_s2 > 0.0 && options.standstill_s >= 0.0 &&
                        options.duration_s >= 0.0 && options.wobble_rad >= 0.0 && options.cadence_ripple >= 0.0 &&
                        options.cadence_ripple < 1.0 && options.stop_every_m >= 0.0;
  if (!positive) {
    return failure(StatusCode::kInvalidArgument,
                   "motion: a limit is zero or negative, or the speed below 0.05 m/s; give positive limits");
  }
  std::vector<Eigen::Vector2d> points;
  if (route.waypoints.size() >= 2) {
    points = lay_out_laps(route, options);
  }
  if (points.size() < 2) {
    return failure(StatusCode::kInvalidArgument, "route: fewer than two different way-points; give at least two");
  }
  Motion motion;
  motion.ripple_ = options.cadence_ripple;
  motion.duration_s_ = options.standstill_s;
  motion.time_limit_s_ =
      options.duration_s > 0.0 ? options.duration_s - options.standstill_s : std::numeric_limits<double>::infinity();
  for (const Stretch& stretch : split_at_stops(split_at_reversals(points), options)) {
    if (!motion.add_drive(stretch, route, options)) {
      break;
    }
  }
  if (motion.legs_.empty()) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("motion: {:.1f} s are too short to move at all; ask for more", options.duration_s));
  }
  motion.duration_s_ = options.duration_s > 0.0 ? options.duration_s : motion.duration_s_ + options.standstill_s;
  return motion;
}

std::vector<Motion::Stretch> Motion::split_at_stops(const std::vector<std::vector<Eigen::Vector2d>>& legs,
                                                    const MotionOptions& options) {
  std::vector<Stretch> stretches;
  double to_stop_m = options.stop_every_m;
  for (const std::vector<Eigen::Vector2d>& leg : legs) {
    Stretch stretch;
    for (std::size_t i = 0; i < leg.size(); ++i) {
      double piece_m = i == 0 ? 0.0 : (leg[i] - leg[i - 1]).norm();
      while (options.stop_every_m > 0.0 && piece_m > to_stop_m + kStopMargin_m && piece_m > 2.0 * kStopMargin_m) {
        const double behind_m = std::max(to_stop_m, kStopMargin_m);
        const Eigen::Vector2d& from = stretch.waypoints.back();
        const Eigen::Vector2d stop = from + (leg[i] - from) * (behind_m / piece_m);
        stretch.waypoints.push_back(stop);
        CounterRandom random(options.seed, kStopStream, stretches.size());
        stretches.push_back(std::move(stretch));
        stretch = {{stop}, random.uniform(0.2, 3.0), 0.0, random.uniform(0.5, 1.0)};
        if (random.uniform() < 0.3) {
          stretch.look_rad = random.uniform(0.7, std::numbers::pi) * (random.uniform() < 0.5 ? 1.0 : -1.0);
        }
        piece_m -= behind_m;
        to_stop_m = options.stop_every_m * random.uniform(0.4, 1.6);
      }
      to_stop_m -= piece_m;
      stretch.waypoints.push_back(leg[i]);
    }
    stretches.push_back(std::move(stretch));
  }
  return stretches;
}

bool Motion::add_drive(const Stretch& stretch, const Route& route, const MotionOptions& options) {
  Path path(stretch.waypoints, route.smoothing_m);
  duration_s_ += stretch.pause_s;
  if (stretch.look_rad != 0.0 && !add_turn(path.at(0.0).heading_rad() + stretch.look_rad, options)) {
    return false;
  }
  if (!legs_.empty() && !add_turn(path.at(0.0).heading_rad(), options)) {
    return false;
  }
  Wobble wobble;
  double wobble_slope = options.wobble_rad * 1.875 / ramp_length(path.length_m());  // rad/m
  CounterRandom random(options.seed, kWobbleStream, legs_.size());
  for (int k = 0; k < 2; ++k) {
    wobble.amplitude_rad[k] = options.wobble_rad * kWobbleShare[k];
    wobble.phase_rad[k] = random.uniform(0.0, 2.0 * std::numbers::pi);
    wobble_slope += wobble.amplitude_rad[k] * 2.0 * std::numbers::pi / kWobbleLength_m[k];
  }
  const auto speed_limit = [&](double s) {
    constexpr double kMargin = 0.98;  // the path's parameter is arc length only nearly
    constexpr double kDelta_m = 0.05;
    const double bend = std::abs(path.at(s).curvature());
    const double change = (path.at(std::min(s + kDelta_m, path.length_m())).curvature() -
                           path.at(std::max(s - kDelta_m, 0.0)).curvature()) /
                          (2.0 * kDelta_m);
    const double pushed_m_s = stretch.speed_share * options.speed_m_s;
    double speed = kMargin * std::min(pushed_m_s, options.yaw_rate_rad_s / (bend + wobble_slope));
    speed = std::min(speed, std::sqrt(options.lateral_acceleration_m_s2 / std::max(bend, 1e-9)));
    speed = std::min(speed, std::sqrt(options.yaw_acceleration_rad_s2 / std::max(std::abs(change), 1e-9)));
    for (const SlowPlace& slow : route.slow_places) {
      if ((path.at(s).position - slow.centre).norm() < slow.radius_m) {
        speed = std::min(speed, slow.speed_m_s);
      }
    }
    return std::max(speed, kSlowest_m_s);
  };
  const ProfileLimits limits{0.98 * options.acceleration_m_s2, options.jerk_m_s3};
  const auto profile_over = [&](double length_m) {
    return SpeedProfile(length_m, kProfileStep_m, speed_limit, limits);
  };
  const double available_s = time_limit_s_ - duration_s_;
  SpeedProfile profile = profile_over(path.length_m());
  const bool whole = profile.duration_s() <= available_s;
  if (!whole) {
    // Stop early, as late as the time allows.
    double fits = 0.0;
    double too_long = path.length_m();
    for (int i = 0; i < 30; ++i) {
      const double middle = 0.5 * (fits + too_long);
      (profile_over(middle).duration_s() <= available_s ? fits : too_long) = middle;
    }
    if (fits < kMinLeg_m) {
      return false;
    }
    profile = profile_over(fits);
  }
  const double end_s = duration_s_ + profile.duration_s();
  legs_.push_back({duration_s_, std::move(path), {}, 1.0, wobble, std::move(profile)});
  duration_s_ = end_s;
  return whole;
}

bool Motion::add_turn(double to_yaw_rad, const MotionOptions& options) {
  const Pose2 pivot = pose_on(legs_.back(), legs_.back().profile.length());
  const double turn_rad = wrap_angle(to_yaw_rad - pivot.yaw);
  if (std::abs(turn_rad) < 1e-6) {
    return true;
  }
  const double rate = 0.75 * options.yaw_rate_rad_s;  // people turn a cart on the spot below its limit
  const ProfileLimits limits{0.5 * options.yaw_acceleration_rad_s2, 2.0 * options.yaw_acceleration_rad_s2};
  SpeedProfile profile(
      std::abs(turn_rad), kProfileStep_rad, [rate](double) { return rate; }, limits);
  const double start_s = duration_s_ + kPause_s;
  const double end_s = start_s + profile.duration_s() + kPause_s;
  if (end_s > time_limit_s_) {
    return false;
  }
  legs_.push_back({start_s, std::nullopt, pivot, turn_rad < 0.0 ? -1.0 : 1.0, {}, std::move(profile)});
  duration_s_ = end_s;
  return true;
}

Pose2 Motion::pose_on(const Leg& leg, double distance) {
  if (!leg.path) {
    return {leg.pivot.x, leg.pivot.y, wrap_angle(leg.pivot.yaw + leg.sense * distance)};
  }
  const PathPoint point = leg.path->at(distance);
  const double length = leg.profile.length();
  const double ramp = ramp_length(length);
  const double envelope = smootherstep(distance / ramp) * smootherstep((length - distance) / ramp);
  double wobble = 0.0;
  for (int k = 0; k < 2; ++k) {
    wobble += leg.wobble.amplitude_rad[k] *
              std::sin(2.0 * std::numbers::pi * distance / kWobbleLength_m[k] + leg.wobble.phase_rad[k]);
  }
  return {point.position.x(), point.position.y(), wrap_angle(point.heading_rad() + envelope * wobble)};
}

double Motion::length_m() const {
  double sum = 0.0;
  for (const Leg& leg : legs_) {
    sum += leg.path ? leg.profile.length() : 0.0;
  }
  return sum;
}

Pose2 Motion::at(double time_s) const {
  auto after = std::upper_bound(legs_.begin(), legs_.end(), time_s,
                                [](double time, const Leg& leg) { return time < leg.start_s; });
  const Leg& leg = after == legs_.begin() ? *after : *(after - 1);
  // Steps change the speed as if time ran a little faster and slower.
  const double since_start_s = time_s - leg.start_s;
  const double stepped_s = leg.path ? ripple_ / kCadence_rad_s * std::sin(kCadence_rad_s * since_start_s) : 0.0;
  return pose_on(leg, leg.profile.distance(since_start_s + stepped_s));
}

}  // namespace submapd::tools
