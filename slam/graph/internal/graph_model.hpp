// What the back end keeps of a run in memory: no cells, only poses, outlines, landmarks and loops.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/graph/internal/uncertain_pose.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/landmark/landmark.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/loop/submap_outline.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd::graph {

// A key-frame without its scan.
struct TrackPoint {
  std::uint64_t scan_index = 0;
  std::int64_t stamp_us = 0;
  Pose2 pose;                              // in the sub-map's frame
  std::array<float, 6> step_covariance{};  // upper triangle by rows; see Keyframe::step_covariance

  [[nodiscard]] Eigen::Matrix3d step() const;
};

struct SubmapRecord {
  Pose2 odom_from_submap;
  std::vector<TrackPoint> keyframes;  // ascending scan_index; of a condensed one the first, and the middle one
  std::shared_ptr<const SubmapOutline> outline;  // of retained ones; never changes, copies of the graph share it
  SubmapState state = SubmapState::kRetained;
  std::uint32_t hub = 0;  // of a condensed one: the retained sub-map it hangs on

  [[nodiscard]] bool condensed() const { return state != SubmapState::kRetained; }
};

// What ties a sub-map to the one before it, or a condensed one to its hub.
struct ChainLink {
  bool linked = false;  // false: a break, `edge` only fixes the gauge
  UncertainPose edge;   // previous_from_this; of a condensed sub-map hub_from_this
  std::vector<VirtualLandmark> landmarks;
};

struct LoopRecord {
  Loop loop;
  std::vector<VirtualLandmark> landmarks;
  // Half widths of the window it was searched in (m, m, rad): how improbable an agreement by chance is.
  Eigen::Vector3d window = Eigen::Vector3d::Ones();
  Eigen::Vector2d place_in_b = Eigen::Vector2d::Zero();  // mean of its landmarks, m
  int demotions = 0;                                     // times it lost its confirmation
};

// What is left of the ties of condensed sub-maps: a row between two retained ones (condensation.hpp).
struct CondensedEdge {
  std::uint32_t a = 0;  // a < b
  std::uint32_t b = 0;
  UncertainPose a_from_b;
  bool loop = false;  // a confirmed loop is part of it
};

// Vectors of one length: submaps, poses and links belong to the same indices.
struct GraphModel {
  GraphParts parts;  // which of them are in use
  std::vector<SubmapRecord> submaps;
  std::vector<Pose2> poses;          // map_from_submap
  std::vector<ChainLink> links;      // links[k] ties k - 1 and k, if neither is condensed; links[0] is unused
  std::vector<LoopRecord> loops;     // in order of discovery; both sub-maps retained
  std::vector<CondensedEdge> edges;  // one a pair, in order of (a, b); both sub-maps retained

  [[nodiscard]] UncertainPose measured(const LoopRecord& loop) const;
  // Whether links[k] is a tie of the graph.
  [[nodiscard]] bool has_link(std::uint32_t k) const {
    return k > 0 && !submaps[k - 1].condensed() && !submaps[k].condensed();
  }
  // Condensed sub-maps follow their hubs.
  void place_condensed();
};

// REQUIRES: at least one key-frame.
[[nodiscard]] SubmapRecord make_record(const FinishedSubmap& submap, SubmapOutline outline);

// Whether the two hold a common scan.
[[nodiscard]] bool share_keyframes(const SubmapRecord& a, const SubmapRecord& b);

// The sequential edge from a to the following b (notes 7): SE(2) mean over the shared key-frames; covariance from their
// spread, from the steps inside a up to b's origin, and a floor for what the scan matcher can resolve. Without shared
// key-frames, or when `linked` is false, a soft edge (10 m, 1 rad) placed by the odometry frame.
[[nodiscard]] ChainLink make_link(const SubmapRecord& a, const SubmapRecord& b, bool linked);

[[nodiscard]] std::size_t bytes_of(const SubmapRecord& record);
[[nodiscard]] std::size_t bytes_of(const std::vector<VirtualLandmark>& landmarks);

}  // namespace submapd::graph
