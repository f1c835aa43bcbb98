// The truncated distance transform by its definition, to hold DistanceLayers against.
#pragma once

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "slam/grid/distance_layers.hpp"

namespace submapd {

using CellSet = std::set<std::pair<int, int>>;  // (ix, iy) of occupied cells

inline int brute_force_distance(const CellSet& occupied, CellIndex c) {
  double best = kDistanceRadiusCells;
  const int end = c.ix + kDistanceRadiusCells;  // farther ones change nothing
  for (auto it = occupied.lower_bound({c.ix - kDistanceRadiusCells, -1}); it != occupied.end() && it->first <= end;
       ++it) {
    best = std::min(best, std::hypot(it->first - c.ix, it->second - c.iy));
  }
  return static_cast<int>(std::lround(best * kDistanceUnitsPerCell));
}

}  // namespace submapd
