#include "slam/output/optimized_trajectory.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace submapd {

OptimizedTrajectory::OptimizedTrajectory(const FinalResult& result, const PoseSpool& poses, std::uint64_t scans)
    : keyframes_(&result.keyframes), poses_(&poses), scans_(scans), misfit_(result.keyframes.size()) {
  for (std::size_t i = 0; i < keyframes_->size(); ++i) position_[(*keyframes_)[i].scan_index] = i;
}

Expected<OptimizedTrajectory> OptimizedTrajectory::make(const FinalResult& result, const PoseSpool& poses,
                                                        std::uint64_t scans) {
  OptimizedTrajectory trajectory(result, poses, scans);
  const Status status = poses.for_each(scans, [&](const SpooledPose& pose) {
    if (pose.keyframe) trajectory.note_step(pose);
    return Status();
  });
  if (!status.ok()) return failure(status);
  return trajectory;
}

// A key-frame as the filter saw it from its predecessor.
void OptimizedTrajectory::note_step(const SpooledPose& pose) {
  const auto found = position_.find(pose.keyframe_scan_index);
  if (!pose.linked || found == position_.end() || found->second == 0) return;
  const std::size_t before = found->second - 1;
  const Pose2 expected = compose((*keyframes_)[before].map_from_base, pose.previous_keyframe_from_base);
  misfit_[before] = between(expected, (*keyframes_)[found->second].map_from_base);
}

std::optional<Pose2> OptimizedTrajectory::pose_of(const SpooledPose& pose) const {
  const auto found = position_.find(pose.keyframe_scan_index);
  if (found == position_.end()) return std::nullopt;
  const std::size_t i = found->second;
  const OptimizedKeyframe& keyframe = (*keyframes_)[i];
  const Pose2 here = compose(keyframe.map_from_base, pose.keyframe_from_base);
  if (i + 1 >= keyframes_->size()) return here;
  const auto span_us = static_cast<double>((*keyframes_)[i + 1].stamp_us - keyframe.stamp_us);
  const auto since_us = static_cast<double>(pose.stamp_us - keyframe.stamp_us);
  if (span_us <= 0.0) return here;
  const double share = std::clamp(since_us / span_us, 0.0, 1.0);
  return compose(here, exp_twist(log_pose(misfit_[i], 1.0), share));
}

Status OptimizedTrajectory::for_each(const Visit& visit) const {
  return poses_->for_each(scans_, [&](const SpooledPose& pose) {
    const std::optional<Pose2> optimised = pose_of(pose);
    if (optimised) return visit(pose, *optimised);
    return Status(StatusCode::kInternal, fmt::format("key-frame {} has no optimised pose", pose.keyframe_scan_index));
  });
}

}  // namespace submapd
