// A finished sub-map in the forms in which matching and landmarks read it. Made once for all the pairs it is part of:
// making it takes longer than many a match.
#pragma once

#include <cstddef>
#include <optional>

#include "slam/loop/cell_plane.hpp"
#include "slam/loop/surface_index.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

struct SubmapView {
  // The sub-map must outlive its view. Implicit: who matches a pair once need not know of views.
  SubmapView(const FinishedSubmap& viewed)  // NOLINT(google-explicit-constructor)
      : submap(viewed), plane(CellPlane::make(viewed)), surface(viewed, plane) {}

  [[nodiscard]] std::size_t bytes() const { return sizeof(*this) + (plane ? plane->bytes() : 0) + surface.bytes(); }

  const FinishedSubmap& submap;
  std::optional<CellPlane> plane;  // nothing if the sub-map is empty or too large
  SurfaceIndex surface;
};

}  // namespace submapd
