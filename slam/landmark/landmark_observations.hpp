// Which track points really see a spot (design notes 8.3).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "slam/submap/finished_submap.hpp"

namespace submapd {

// Whether a beam of the key-frame, unwarped, ends near `place` (sub-map frame) within max_range_m: line of sight shown
// by the measurement itself.
[[nodiscard]] bool sees(const Keyframe& keyframe, const Eigen::Vector2d& place, double max_range_m);

// Whether one of the sub-map's key-frames is this scan.
[[nodiscard]] bool has_scan(const FinishedSubmap& submap, std::uint64_t scan_index);

// At most `count` key-frames of `submap` that see the spot at `place` (its frame, m), spread over time, ascending.
// Those it shares with `other` carry nothing new and are taken last.
[[nodiscard]] std::vector<std::uint32_t> observers_of(const Eigen::Vector2d& place, const FinishedSubmap& submap,
                                                      const FinishedSubmap& other, int count, double max_range_m);

}  // namespace submapd
