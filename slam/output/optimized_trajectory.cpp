#include "slam/output/optimized_trajectory.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace submapd {

OptimizedTrajectory::OptimizedTrajectory(const FinalResult& result, const PoseSpool& poses, std::uint64_t scans)
    : keyframes_(&result.keyframes), poses_(&poses), scans_(scans), misfit_(result.keyframes.size()) {}

Expected<OptimizedTrajectory> OptimizedTrajectory::make(const FinalResult& result, const PoseSpool& poses,
                                                        std::uint64_t scans) {
  OptimizedTrajectory trajectory(result, poses, scans);
  Chain chain;
  const Status status = poses.for_each(scans, [&](const SpooledPose& pose) {
    if (pose.keyframe) trajectory.note_step(chain, pose);
    trajectory.advance(chain, pose);
    return Status();
  });
  if (!status.ok()) return failure(status);
  return trajectory;
}

std::optional<std::size_t> OptimizedTrajectory::optimised(std::uint64_t scan_index) const {
  const auto found = std::lower_bound(
      keyframes_->begin(), keyframes_->end(), scan_index,
      [](const OptimizedKeyframe& keyframe, std::uint64_t index) { return keyframe.scan_index < index; });
  if (found == keyframes_->end() || found->scan_index != scan_index) return std::nullopt;
  return static_cast<std::size_t>(found - keyframes_->begin());
}

void OptimizedTrajectory::advance(Chain& chain, const SpooledPose& pose) const {
  if (!pose.keyframe && pose.keyframe_scan_index == chain.keyframe_scan_index) return;
  if (const auto anchor = optimised(pose.keyframe_scan_index)) {
    chain = {anchor, {}, pose.keyframe_scan_index, false};
  } else if (pose.keyframe && pose.linked && chain.anchor) {
    chain.anchor_from_keyframe = compose(chain.anchor_from_keyframe, pose.previous_keyframe_from_base);
    chain.keyframe_scan_index = pose.keyframe_scan_index;
  } else {
    chain = {std::nullopt, {}, pose.keyframe_scan_index, chain.lost || !pose.keyframe};
  }
}

// An optimised key-frame as the filter saw it from the one before.
void OptimizedTrajectory::note_step(const Chain& before, const SpooledPose& pose) {
  const auto found = optimised(pose.keyframe_scan_index);
  if (!pose.linked || !found || !before.anchor || *found != *before.anchor + 1) return;
  const Pose2 step = compose(before.anchor_from_keyframe, pose.previous_keyframe_from_base);
  const Pose2 expected = compose((*keyframes_)[*before.anchor].map_from_base, step);
  misfit_[*before.anchor] = between(expected, (*keyframes_)[*found].map_from_base);
}

std::optional<Pose2> OptimizedTrajectory::pose_of(const Chain& chain, const SpooledPose& pose) const {
  if (!chain.anchor) return std::nullopt;
  const std::size_t i = *chain.anchor;
  const OptimizedKeyframe& keyframe = (*keyframes_)[i];
  const Pose2 here = compose(compose(keyframe.map_from_base, chain.anchor_from_keyframe), pose.keyframe_from_base);
  if (i + 1 >= keyframes_->size()) return here;
  const auto span_us = static_cast<double>((*keyframes_)[i + 1].stamp_us - keyframe.stamp_us);
  const auto since_us = static_cast<double>(pose.stamp_us - keyframe.stamp_us);
  if (span_us <= 0.0) return here;
  const double share = std::clamp(since_us / span_us, 0.0, 1.0);
  return compose(here, exp_twist(log_pose(misfit_[i], 1.0), share));
}

Status OptimizedTrajectory::for_each(const Visit& visit) const {
  Chain chain;
  return poses_->for_each(scans_, [&](const SpooledPose& pose) {
    advance(chain, pose);
    const std::optional<Pose2> optimised = pose_of(chain, pose);
    if (optimised) return visit(pose, *optimised);
    if (chain.lost) return Status();
    return Status(StatusCode::kInternal, fmt::format("key-frame {} has no optimised pose", pose.keyframe_scan_index));
  });
}

}  // namespace submapd
