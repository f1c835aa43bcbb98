// What two chunks of a log share: the same scans, mapped in the end of one and in the beginning of the next.
//
// The chunk before keeps where it saw them; where the next one made key-frames of them, its sub-maps get the same
// key-frames. So the two are tied as neighbours of one run are (make_link() in slam/graph): by the relative pose of the
// same scans in both, with a covariance from how much they differ about it.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "slam/filter/mapper.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd::tools {

// Where a chunk saw a scan of its seam.
struct SeamPose {
  std::uint64_t scan_index = 0;
  std::uint64_t keyframe_scan_index = 0;                 // its own newest key-frame ...
  Pose2 keyframe_from_base;                              // ... and the pose relative to it
  Pose2 step;                                            // the pose seen from its last key-frame before this scan
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of the match, in the base's frame
  bool linked = false;                                   // to that key-frame
  bool lost = false;
  bool degenerate = false;
};

[[nodiscard]] SeamPose seam_pose(const ScanReport& report);

// Puts the key-frames of `next`, the next chunk's first sub-map, in place of those that `submap` made of the seam.
// Returns how many there are now. REQUIRES: `submap` began before the seam; `seam` in order of scan_index.
std::size_t share_seam(FinishedSubmap& submap, const std::vector<SeamPose>& seam, const FinishedSubmap& next);

}  // namespace submapd::tools
