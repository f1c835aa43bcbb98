// The figures a match is judged by: score, overlap and free-space contradiction (design notes 9.2). Of sub-maps that
// have a plane.
#pragma once

#include "slam/base/pose2.hpp"
#include "slam/loop/submap_view.hpp"

namespace submapd::internal {

struct Overlap {
  double area_m2 = 0.0;  // known to both, occupied or free
  double share = 0.0;    // of the smaller sub-map's known area
};
[[nodiscard]] Overlap measure_overlap(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b);

// Both of the lasting surface points that lie where the other sub-map knows the cell; 0 if those are too few to judge
// by.
struct Agreement {
  double fitting = 0.0;  // share that has a fitting piece of surface there
  // Share that the other has looked through with certainty; of the two directions the worse one, since furniture that
  // is in one room only contradicts in one direction only.
  double contradicted = 0.0;
};
[[nodiscard]] Agreement measure_agreement(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b);

}  // namespace submapd::internal
