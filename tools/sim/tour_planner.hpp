// A tour through a floor plan that has no way-points: far corners of what the cart can reach, visited in turn.
//
// Free space is sampled on a grid and kept at a distance from walls. Goals are chosen farthest first, visited nearest first
// and joined by shortest ways that prefer the middle of corridors. The same seed gives the same tour.
#pragma once

#include <cstdint>

#include "slam/base/status.hpp"
#include "tools/sim/floor_plan.hpp"
#include "tools/sim/motion.hpp"

namespace submapd::tools {

struct TourOptions {
  std::uint64_t seed = 1;       // chooses the start
  double grid_m = 0.2;          // coarser if the plan is very large
  double goal_spacing_m = 7.0;  // no goal nearer than this, by way, to another
  int max_goals = 24;
};

// A closed route. Fails if no place is wide enough for the cart.
[[nodiscard]] Expected<Route> plan_tour(const FloorPlan& plan, const TourOptions& options);

// Smallest distance to a wall along a motion, sampled every 5 cm of time at 1 m/s (50 ms); limit_m if none is nearer.
[[nodiscard]] double min_clearance(const World& world, const Motion& motion, double limit_m);

}  // namespace submapd::tools
