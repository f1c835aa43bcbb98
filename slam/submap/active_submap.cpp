#include "slam/submap/active_submap.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {

ActiveSubmap::ActiveSubmap(const IndexMapOptions& options, const SubmapLimits& limits, DistanceLayers& layers,
                           int max_beams)
    : limits_(limits),
      map_(options, layers),
      keyframes_(static_cast<std::size_t>(kMostFullness * limits.keyframes) + 1 +
                 static_cast<std::size_t>(limits.pending_keyframes)) {
  for (Keyframe& k : keyframes_) k.ranges_mm.reserve(static_cast<std::size_t>(max_beams));
  placed_.reserve(static_cast<std::size_t>(max_beams));
}

void ActiveSubmap::open(std::uint32_t index, const Pose2& odom_from_submap, bool linked_to_previous) {
  map_.clear();
  used_keyframes_ = 0;
  index_ = index;
  odom_from_submap_ = odom_from_submap;
  linked_to_previous_ = linked_to_previous;
  path_m_ = 0.0;
  turned_rad_ = 0.0;
  low_.setZero();
  high_.setZero();
}

void ActiveSubmap::insert(const Pose2& pose, const Scan& scan, const Twist2& twist,
                          const Eigen::Matrix3d& step_covariance, bool degenerate, std::span<const BeamEnd> beams,
                          const Eigen::Vector2f& origin) {
  if (used_keyframes_ > 0) {
    const Pose2 step = between(last_keyframe().pose, pose);
    path_m_ += std::hypot(step.x, step.y);
    turned_rad_ += std::abs(step.yaw);
    low_ = low_.cwiseMin(pose.translation());
    high_ = high_.cwiseMax(pose.translation());
  }
  Keyframe& k = keyframes_[used_keyframes_++];
  k.scan_index = scan.index;
  k.stamp_us = scan.stamp_us;
  k.pose = pose;
  k.twist = twist;
  k.step_covariance = step_covariance;
  k.degenerate = degenerate;
  k.geometry = scan.geometry;
  const std::size_t n = std::min(scan.ranges_mm.size(), k.ranges_mm.capacity());
  k.ranges_mm.assign(scan.ranges_mm.begin(), scan.ranges_mm.begin() + static_cast<std::ptrdiff_t>(n));

  const Eigen::Vector2f placed_origin = place_beams(pose, beams, origin, placed_);
  map_.insert(placed_origin, placed_);
}

double ActiveSubmap::fullness(FinishReason* reason) const {
  if (limits_.never_full) return 0.0;
  const Eigen::Vector2d size = high_ - low_;
  const struct {
    double share;
    FinishReason why;
  } limits[] = {
      {path_m_ / limits_.path_m, FinishReason::kPath},
      {turned_rad_ / limits_.heading_rad, FinishReason::kHeading},
      {size.maxCoeff() / limits_.extent_m, FinishReason::kExtent},
      {static_cast<double>(used_keyframes_) / limits_.keyframes, FinishReason::kKeyframes},
      {static_cast<double>(map_.blocks_used()) / limits_.blocks, FinishReason::kBlocks},
  };
  double fullest = 0.0;
  for (const auto& limit : limits) {
    if (limit.share <= fullest) continue;
    fullest = limit.share;
    if (reason != nullptr) *reason = limit.why;
  }
  return fullest;
}

FinishedSubmap ActiveSubmap::freeze(const Uuid& cart, const Uuid& run, FinishReason reason) const {
  FinishedSubmap out;
  out.id = {cart, run, index_};
  out.odom_from_submap = odom_from_submap_;
  out.reason = reason;
  out.cell_m = map_.cell_m();
  out.linked_to_previous = linked_to_previous_;
  out.keyframes.assign(keyframes_.begin(), keyframes_.begin() + static_cast<std::ptrdiff_t>(used_keyframes_));
  out.blocks = map_.export_blocks();
  out.surface = map_.export_surface();
  return out;
}

std::size_t ActiveSubmap::keyframe_bytes() const {
  std::size_t bytes = 0;
  for (const Keyframe& k : keyframes_) bytes += sizeof(Keyframe) + k.ranges_mm.capacity() * sizeof(std::uint16_t);
  return bytes;
}

}  // namespace submapd
