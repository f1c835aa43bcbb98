#include "tools/replay/seam.hpp"

#include <algorithm>
#include <utility>

#include "slam/base/small_matrix.hpp"

namespace submapd::tools {
namespace {

template <typename T>
const T* find_scan(const std::vector<T>& sorted, std::uint64_t scan_index) {
  const auto found = std::lower_bound(sorted.begin(), sorted.end(), scan_index,
                                      [](const T& item, std::uint64_t index) { return item.scan_index < index; });
  return found != sorted.end() && found->scan_index == scan_index ? &*found : nullptr;
}

}  // namespace

SeamPose seam_pose(const ScanReport& report) {
  SeamPose pose;
  pose.scan_index = report.scan_index;
  pose.keyframe_scan_index = report.keyframe_scan_index;
  pose.keyframe_from_base = report.keyframe_from_base;
  pose.step = report.keyframe ? report.keyframe_step : report.keyframe_from_base;
  pose.linked = !report.keyframe || report.keyframe_linked;
  pose.covariance = turned(report.covariance, -report.submap_from_base.yaw);
  pose.lost = report.lost;
  pose.degenerate = report.degenerate;
  return pose;
}

std::size_t share_seam(FinishedSubmap& submap, const std::vector<SeamPose>& seam, const FinishedSubmap& next) {
  if (seam.empty()) return 0;
  std::vector<Keyframe> kept;
  for (const Keyframe& keyframe : submap.keyframes) {
    if (keyframe.scan_index < seam.front().scan_index) kept.push_back(keyframe);
  }
  std::size_t shared = 0;
  Eigen::Matrix3d before = Eigen::Matrix3d::Zero();
  for (const Keyframe& keyframe : next.keyframes) {
    const SeamPose* const seen = find_scan(seam, keyframe.scan_index);
    if (seen == nullptr) break;
    if (seen->lost) continue;
    const Keyframe* const by = find_scan(submap.keyframes, seen->keyframe_scan_index);
    if (by == nullptr) continue;  // another sub-map's
    Keyframe same = keyframe;
    same.pose = compose(by->pose, seen->keyframe_from_base);
    // Both ends of the step were matched to the same map.
    if (shared == 0) before = seen->covariance;
    same.step_covariance = before + turned(seen->covariance, between(kept.back().pose, same.pose).yaw);
    same.degenerate = seen->degenerate;
    before = seen->covariance;
    kept.push_back(std::move(same));
    ++shared;
  }
  submap.keyframes = std::move(kept);
  return shared;
}

}  // namespace submapd::tools
