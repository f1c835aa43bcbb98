// What the branch and bound is fed with: thinned points, angles worth trying, levels of the pyramid (design notes 9.1).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "slam/loop/surface_index.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd::internal {

// Surface means, at most one in each 10 cm cell, in larger cells if that leaves more than 800.
[[nodiscard]] std::vector<Eigen::Vector2d> thinned_points(const SurfaceIndex& surface);

// Distance from the origin within which 95 % of the points lie. REQUIRES: not empty.
[[nodiscard]] double outer_radius_m(const std::vector<Eigen::Vector2d>& points);

// Angles of a_from_b in [low, high] near the peaks of the circular correlation of the two normal histograms; every
// angle if a sub-map has no normals.
[[nodiscard]] std::vector<double> angles_by_normals(const FinishedSubmap& a, const FinishedSubmap& b, double low_rad,
                                                    double high_rad, double cell_m, double radius_m);

// Levels of the pyramid that suit a window of this half width.
[[nodiscard]] int levels_for(double half_window_m, double cell_m);

}  // namespace submapd::internal
