#include "daemon/odometry_track.hpp"

#include <algorithm>
#include <cmath>

#include "slam/submap/submap_check.hpp"

namespace submapd {
namespace {

constexpr double kFastest_m_s = 6.0;
constexpr double kFastest_rad_s = 6.0;
constexpr double kJitter_m = 0.05;  // of stamps and steps
constexpr double kJitter_rad = 0.05;

}  // namespace

bool is_jump(const OdometrySample& before, const OdometrySample& now) noexcept {
  const Pose2 moved = between(before.odom_from_base, now.odom_from_base);
  const double seconds = static_cast<double>(now.mono_ns - before.mono_ns) * 1e-9;
  return !(std::hypot(moved.x, moved.y) <= kJitter_m + kFastest_m_s * seconds &&
           std::abs(moved.yaw) <= kJitter_rad + kFastest_rad_s * seconds);
}

std::optional<OdometrySample> OdometryTrack::find(std::int64_t mono_ns) const noexcept {
  const std::size_t known = std::min(count_, kKept);
  std::size_t after = 0;  // samples after the instant
  while (after < known && newest(after).mono_ns > mono_ns) ++after;
  if (after == known) return std::nullopt;
  const OdometrySample& before = newest(after);
  if (before.mono_ns == mono_ns) return before;
  const bool between_two = after > 0;
  if (!between_two && after + 1 == known) return std::nullopt;
  const OdometrySample& a = between_two ? before : newest(after + 1);
  const OdometrySample& b = between_two ? newest(after - 1) : before;
  if (a.stretch != b.stretch || b.mono_ns - a.mono_ns > kLongestGap_ns || mono_ns - b.mono_ns > kExtrapolation_ns) {
    return std::nullopt;
  }
  const double share = static_cast<double>(mono_ns - a.mono_ns) / static_cast<double>(b.mono_ns - a.mono_ns);
  const OdometrySample found{mono_ns, interpolate(a.odom_from_base, b.odom_from_base, share), a.stretch};
  return is_sound(found.odom_from_base) ? std::optional(found) : std::nullopt;
}

std::optional<Pose2> OdometryTrack::pose_at(std::int64_t mono_ns) noexcept {
  while (const OdometrySample* const sample = samples_.front()) {
    kept_[count_++ % kKept] = *sample;
    samples_.pop();
  }
  const std::optional<OdometrySample> found = find(mono_ns);
  if (!found) return std::nullopt;
  // The mapper takes the motion from scan to scan: over a jump there is none, so one scan goes without.
  const bool jumped = found->stretch != last_.stretch || is_jump(last_, *found);
  last_ = *found;
  if (jumped) return std::nullopt;
  joined_.fetch_add(1, std::memory_order_relaxed);
  return found->odom_from_base;
}

bool OdometryTrack::at(std::int64_t mono_ns, driver::Odometry& odometry) noexcept {
  const std::optional<Pose2> pose = pose_at(mono_ns);
  if (pose) odometry = {pose->x, pose->y, pose->yaw};
  return pose.has_value();
}

}  // namespace submapd
