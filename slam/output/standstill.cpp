#include "slam/output/standstill.hpp"

#include <cmath>
#include <optional>

namespace submapd {
namespace {

constexpr double kPlace_m = 0.015;
constexpr double kPlace_rad = 0.0105;
constexpr std::int64_t kMargin_us = 2'000'000;
constexpr std::int64_t kShortest_us = 10'000'000;

}  // namespace

Expected<std::vector<Standstill>> find_standstills(const PoseSpool& poses, std::int64_t after_us) {
  std::vector<Standstill> found;
  std::optional<SpooledPose> first;  // of the place the cart is at
  std::int64_t last_us = 0;
  const auto left = [&] {
    if (!first || last_us - first->stamp_us < kShortest_us) return;
    found.push_back({first->stamp_us + kMargin_us, last_us - kMargin_us});
  };
  const Status read = poses.for_each(poses.size(), [&](const SpooledPose& pose) {
    if (pose.stamp_us <= after_us) return Status();
    const auto at_first = [&] {
      if (!first || pose.keyframe || pose.keyframe_scan_index != first->keyframe_scan_index) return false;
      const Pose2 off = between(first->keyframe_from_base, pose.keyframe_from_base);
      return off.translation().norm() < kPlace_m && std::abs(off.yaw) < kPlace_rad;
    };
    if (!at_first()) {
      left();
      first = pose;
    }
    last_us = pose.stamp_us;
    return Status();
  });
  if (!read.ok()) return failure(read);
  left();
  return found;
}

}  // namespace submapd
