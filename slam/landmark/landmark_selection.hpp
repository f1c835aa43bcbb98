// Choice of the virtual landmarks of a pair of matched sub-maps and of their observations (design notes, section 8).
#pragma once

#include <vector>

#include "slam/landmark/landmark.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/loop/submap_view.hpp"

namespace submapd {

struct LandmarkOptions {
  int max_landmarks = 12;  // a pair
  double min_spacing_m = 1.5;
  double max_range_m = 12.0;            // of the key-frames that observe it
  int observations_per_side = 3;        // key-frames a sub-map, spread over it
  double information_inflation = 30.0;  // kappa
};

// Well-seen spots that both maps hold, chosen greedily D-optimal and apart, each refined against b's own map.
// Fewer than two when the overlap does not carry them. REQUIRES: match.verdict == kAccepted (or a refined adjacent
// pair).
[[nodiscard]] std::vector<VirtualLandmark> choose_landmarks(const SubmapView& a, const SubmapView& b,
                                                            const SubmapMatch& match, const LandmarkOptions& options);

}  // namespace submapd
