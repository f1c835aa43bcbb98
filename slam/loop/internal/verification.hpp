// The figures a match is judged by: score, overlap and free-space contradiction (design notes 9.2).
#pragma once

#include "slam/base/pose2.hpp"
#include "slam/loop/cell_plane.hpp"
#include "slam/loop/surface_index.hpp"

namespace submapd::internal {

// One side of a match: everything that is read about a sub-map.
struct MapView {
  CellPlane plane;
  SurfaceIndex surface;
};

struct Overlap {
  double area_m2 = 0.0;  // known to both, occupied or free
  double share = 0.0;    // of the smaller sub-map's known area
};
[[nodiscard]] Overlap measure_overlap(const MapView& a, const MapView& b, const Pose2& a_from_b);

// Share of the surface points lying where the other sub-map knows the cells that have a fitting piece of surface there.
[[nodiscard]] double fitting_share(const MapView& a, const MapView& b, const Pose2& a_from_b);

// Share of the lasting surface points lying where the other sub-map knows the cells that it has looked through with
// certainty; of the two directions the worse one, since furniture that is in one room only contradicts in one direction
// only.
[[nodiscard]] double contradiction_share(const MapView& a, const MapView& b, const Pose2& a_from_b);

}  // namespace submapd::internal
