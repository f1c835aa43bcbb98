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

// Share of the surface points lying where the other sub-map knows the cells that have a fitting piece of surface there.
[[nodiscard]] double fitting_share(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b);

// Share of the lasting surface points lying where the other sub-map knows the cells that it has looked through with
// certainty; of the two directions the worse one, since furniture that is in one room only contradicts in one direction
// only.
[[nodiscard]] double contradiction_share(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b);

}  // namespace submapd::internal
