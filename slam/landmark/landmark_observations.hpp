// Which track points really see a spot, and what they see of it (design notes 8.3).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "slam/landmark/landmark.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// Whether a beam of the key-frame, unwarped, ends near `place` (sub-map frame) within max_range_m: line of sight shown
// by the measurement itself.
[[nodiscard]] bool sees(const Keyframe& keyframe, const Eigen::Vector2d& place, double max_range_m);

// Whether one of the sub-map's key-frames is this scan.
[[nodiscard]] bool has_scan(const FinishedSubmap& submap, std::uint64_t scan_index);

// The side of a landmark that one sub-map shows.
struct LandmarkSide {
  const FinishedSubmap& submap;
  const FinishedSubmap& other;  // key-frames it shares with this one carry nothing new, and are taken last
  Eigen::Vector2d place;        // in the sub-map's frame, m
  Eigen::Matrix2d covariance;   // of the place, m^2
};

// z_ij from at most `count` key-frames that see the spot, spread over time. Each carries the side's covariance times
// their number, so that together they count once.
[[nodiscard]] std::vector<LandmarkObservation> observe(const LandmarkSide& side, int count, double max_range_m);

}  // namespace submapd
