// A sub-map under construction: its index map and the key-frames inserted so far.
//
// Buffers are taken once and reused for sub-map after sub-map. Owned and called by the mapper's thread; freeze() may be
// called from another thread once the mapper has handed the sub-map over.
#pragma once

#include <cstdint>
#include <vector>

#include "slam/grid/index_map.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// When a sub-map is full (design notes, section 7). "Half full" on the same scale opens its successor.
struct SubmapLimits {
  double path_m = 20.0;
  double heading_rad = 9.4248;  // 540 deg of turning
  double extent_m = 50.0;
  int keyframes = 150;
  int pending_keyframes = 16;  // of particles that do not agree yet: may all come at once, on top of a full sub-map
  int blocks = 350;            // of the pool's 400
  bool never_full = false;     // [experiment]: the run is one map, as far as its pools and key-frames reach
};

// A sub-map whose particles disagree may grow this far beyond its limits, on the scale of fullness().
inline constexpr double kMostFullness = 1.25;

class ActiveSubmap {
 public:
  ActiveSubmap(const IndexMapOptions& options, const SubmapLimits& limits, DistanceLayers& layers, int max_beams);

  // Starts anew at a pose in the odom frame.
  void open(std::uint32_t index, const Pose2& odom_from_submap, bool linked_to_previous);

  // Inserts a key-frame. `beams` and `origin` are in the base frame; `pose` in this sub-map's frame. REQUIRES: room() >
  // 0.
  void insert(const Pose2& pose, const Scan& scan, const Twist2& twist, const Eigen::Matrix3d& step_covariance,
              bool degenerate, std::span<const BeamEnd> beams, const Eigen::Vector2f& origin);

  // 0 empty .. 1 full, by the limit that is nearest; `reason` tells which.
  [[nodiscard]] double fullness(FinishReason* reason = nullptr) const;

  [[nodiscard]] FinishedSubmap freeze(const Uuid& cart, const Uuid& run, FinishReason reason) const;

  [[nodiscard]] const IndexMap& map() const { return map_; }
  [[nodiscard]] std::uint32_t index() const { return index_; }
  [[nodiscard]] const Pose2& odom_from_submap() const { return odom_from_submap_; }
  [[nodiscard]] int keyframes() const { return static_cast<int>(used_keyframes_); }
  [[nodiscard]] int room() const { return static_cast<int>(keyframes_.size() - used_keyframes_); }
  [[nodiscard]] const Keyframe& last_keyframe() const { return keyframes_[used_keyframes_ - 1]; }
  [[nodiscard]] std::size_t keyframe_bytes() const;

 private:
  SubmapLimits limits_;
  IndexMap map_;
  std::vector<Keyframe> keyframes_;  // ranges reserved
  std::size_t used_keyframes_ = 0;
  std::vector<BeamEnd> placed_;  // beams in the sub-map's frame
  std::uint32_t index_ = 0;
  Pose2 odom_from_submap_;
  bool linked_to_previous_ = true;
  double path_m_ = 0.0;
  double turned_rad_ = 0.0;
  Eigen::Vector2d low_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d high_ = Eigen::Vector2d::Zero();
};

}  // namespace submapd
