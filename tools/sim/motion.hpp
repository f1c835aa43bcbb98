// The exact motion of the simulated cart: its pose at any time.
//
// The cart follows a route leg by leg. A leg is a smooth path driven from rest to rest; where the way-points reverse,
// the cart stops and turns on the spot. Position is twice continuously differentiable in time, the yaw rate continuous.
// Immutable; needs about 1 kB a metre of way.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <numbers>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "tools/sim/path.hpp"
#include "tools/sim/speed_profile.hpp"

namespace submapd::tools {

// A place where the cart goes slower.
struct SlowPlace {
  Eigen::Vector2d centre;  // m, in the world's frame
  double radius_m = 0.0;
  double speed_m_s = 0.0;
};

struct Route {
  std::vector<Eigen::Vector2d> waypoints;  // m, in the world's frame
  bool closed = false;       // the last way-point leads on to the first; otherwise further laps go to and fro
  double smoothing_m = 0.8;  // width of the filter that rounds corners, see Path
  double jitter_m = 0.0;     // each way-point of each lap is moved by up to this much along x and y
  std::vector<SlowPlace> slow_places = {};
};

struct MotionOptions {
  std::uint64_t seed = 1;
  double duration_s = 0.0;  // laps are repeated, then cut, to fill it; 0: the way-points once
  double speed_m_s = 1.5;
  double acceleration_m_s2 = 1.0;          // along the path
  double jerk_m_s3 = 2.5;                  // along the path
  double lateral_acceleration_m_s2 = 1.5;  // across the path
  double yaw_rate_rad_s = 120.0 * std::numbers::pi / 180.0;
  double yaw_acceleration_rad_s2 = 4.0;
  double standstill_s = 1.0;    // before the first and after the last leg
  double wobble_rad = 0.014;    // largest deviation of the heading from the path's direction
  double cadence_ripple = 0.0;  // share of the speed by which the pusher's steps, 1.9 a second, change it
  double stop_every_m = 0.0;    // about so often the cart stops, and at some stops looks round; 0: it does not
};

class Motion {
 public:
  // Fails if fewer than two different way-points are given or an option is out of its range.
  [[nodiscard]] static Expected<Motion> along(const Route& route, const MotionOptions& options);

  [[nodiscard]] double duration_s() const { return duration_s_; }
  [[nodiscard]] double length_m() const;
  // Pose of the base, yaw wrapped, at a time since the start; before and after the motion the cart stands.
  [[nodiscard]] Pose2 at(double time_s) const;

 private:
  struct Wobble {
    double amplitude_rad[2] = {0.0, 0.0};
    double phase_rad[2] = {0.0, 0.0};
  };
  // Driving along a path, or, without one, turning on the spot.
  struct Leg {
    double start_s = 0.0;
    std::optional<Path> path;
    Pose2 pivot;         // pose before the turn
    double sense = 1.0;  // of the turn: +1 to the left
    Wobble wobble;
    SpeedProfile profile;  // of metres, or of radians
  };

  // A leg's way-points, and what happens before it.
  struct Stretch {
    std::vector<Eigen::Vector2d> waypoints;
    double pause_s = 0.0;
    double look_rad = 0.0;  // turn to there and back; 0: none
    double speed_share = 1.0;
  };

  Motion() = default;
  [[nodiscard]] static std::vector<Stretch> split_at_stops(const std::vector<std::vector<Eigen::Vector2d>>& legs,
                                                           const MotionOptions& options);
  // Each returns whether the leg was added whole: if not, the time is used up.
  bool add_drive(const Stretch& stretch, const Route& route, const MotionOptions& options);
  bool add_turn(double to_yaw_rad, const MotionOptions& options);
  [[nodiscard]] static Pose2 pose_on(const Leg& leg, double distance);

  std::vector<Leg> legs_;
  double duration_s_ = 0.0;
  double time_limit_s_ = 0.0;  // when the cart must have come to rest
  double ripple_ = 0.0;
};

}  // namespace submapd::tools
