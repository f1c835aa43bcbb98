// A few hundred bytes that stand for a sub-map when loop candidates are ranked (design notes, section 10).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// Kept in memory for every sub-map of a run while its cells may be on disk only.
struct SubmapOutline {
  std::uint32_t index = 0;
  double coarse_cell_m = 0.5;
  // Known coarse cells (at least half of whose fine cells are known), sub-map frame, sorted by (y, x).
  std::vector<std::array<std::int16_t, 2>> known;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // of the known area, m
  double radius_m = 0.0;                             // about the centre, 95 % of the known area
  std::array<float, 360> normal_histogram{};         // surface length by normal direction, sums to 1
  [[nodiscard]] double known_area_m2() const {
    return static_cast<double>(known.size()) * coarse_cell_m * coarse_cell_m;
  }
};

[[nodiscard]] SubmapOutline make_outline(const FinishedSubmap& submap);

// Area known to both when b lies at a_from_b, each of a's cells grown by grow_m.
[[nodiscard]] double overlap_m2(const SubmapOutline& a, const SubmapOutline& b, const Pose2& a_from_b, double grow_m);

}  // namespace submapd
