#include "slam/submap/submap_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tuple>
#include <vector>

namespace submapd {
namespace {

bool within(double value, double limit) {  // false for NaN
  return std::abs(value) <= limit;
}

// Track points and tracked scans are both in order of time.
bool follows(const Keyframe& item, const Keyframe* previous) {
  return previous == nullptr || (item.scan_index > previous->scan_index && item.stamp_us >= previous->stamp_us);
}

template <typename T>
Status check_list(std::string_view name, const std::vector<T>& items) {
  for (std::size_t i = 0; i < items.size(); ++i) {
    const std::string_view problem = problem_of(items[i], i == 0 ? nullptr : &items[i - 1]);
    if (!problem.empty()) {
      return Status(StatusCode::kInvalidArgument, fmt::format("sub-map: {} {}: {}", name, i, problem));
    }
  }
  return {};
}

}  // namespace

bool is_sound(const Pose2& pose) {
  return within(pose.x, kMaxCoordinate_m) && within(pose.y, kMaxCoordinate_m) && within(pose.yaw, kMaxCoordinate_m);
}

bool is_sound(const ScanGeometry& geometry) {
  return within(geometry.first_angle_rad, 100.0) && within(geometry.angle_step_rad, 100.0) &&
         within(geometry.sweep_s, 100.0) && geometry.sweep_s >= 0.0 && within(geometry.range_max_m, 1e4) &&
         geometry.range_min_m >= 0.0 && geometry.range_min_m <= geometry.range_max_m &&
         is_sound(geometry.base_from_sensor);
}

std::string_view head_problem(const FinishedSubmap& submap) {
  if (!is_sound(submap.odom_from_submap)) return "pose in the odom frame not finite or too far";
  if (submap.reason > FinishReason::kCommand) return "unknown finish reason";
  if (!(submap.cell_m >= 0.001 && submap.cell_m <= 10.0)) return "cell size not in 0.001..10 m";
  return {};
}

std::string_view problem_of(const Keyframe& keyframe, const Keyframe* previous) {
  if (!is_sound(keyframe.pose)) return "pose not finite or too far";
  if (previous == nullptr && keyframe.pose != Pose2{}) return "pose of the first key-frame is not the identity";
  if (!within(keyframe.twist.vx, 1e3) || !within(keyframe.twist.vy, 1e3) || !within(keyframe.twist.wz, 1e3)) {
    return "twist not finite or too fast";
  }
  if (!keyframe.step_covariance.allFinite() || (keyframe.step_covariance.diagonal().array() < 0.0).any()) {
    return "covariance not finite or with a negative variance";
  }
  if (!is_sound(keyframe.geometry)) return "scan geometry out of range";
  if (keyframe.ranges_mm.size() > kMaxBeams) return "too many beams";
  if (!follows(keyframe, previous)) return "not in order of time";
  return {};
}

std::string_view problem_of(const OccupancyBlock& block, const OccupancyBlock* previous) {
  const auto inside = [](std::int32_t index) { return index >= -kMaxBlockIndex && index < kMaxBlockIndex; };
  if (!inside(block.bx) || !inside(block.by)) return "block too far";
  if (previous != nullptr && std::tie(previous->by, previous->bx) >= std::tie(block.by, block.bx)) {
    return "blocks not sorted by (by, bx) or not distinct";
  }
  return {};
}

std::string_view problem_of(const SurfacePoint& point, const SurfacePoint* /*previous*/) {
  if (!within(point.x, kMaxCoordinate_m) || !within(point.y, kMaxCoordinate_m)) return "point not finite or too far";
  const float norm2 = point.normal_x * point.normal_x + point.normal_y * point.normal_y;
  if (norm2 != 0.0F && !within(norm2 - 1.0F, 1e-2)) return "normal neither zero nor of unit length";
  if (!within(point.sigma_m, 1e3) || point.sigma_m < 0.0F) return "sigma out of range";
  return {};
}

Status check_submap(const FinishedSubmap& submap) {
  if (const std::string_view problem = head_problem(submap); !problem.empty()) {
    return Status(StatusCode::kInvalidArgument, fmt::format("sub-map: {}", problem));
  }
  if (submap.keyframes.empty()) return Status(StatusCode::kInvalidArgument, "sub-map: no key-frame");
  if (Status status = check_list("key-frame", submap.keyframes); !status.ok()) return status;
  if (Status status = check_list("block", submap.blocks); !status.ok()) return status;
  return check_list("surface point", submap.surface);
}

}  // namespace submapd
