// Gauss-Newton alignment of two sub-maps' surfaces, point to line, sub-cell (design notes 5.2, 9.2).
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "slam/base/pose2.hpp"
#include "slam/loop/surface_index.hpp"

namespace submapd::internal {

enum class AlignDirection { kBoth, kAOnB, kBOnA };

struct Alignment {
  Pose2 a_from_b;
  Eigen::Vector2d pivot = Eigen::Vector2d::Zero();  // mean of the paired points, a's frame, m
  // Sum of w J^T J / sigma^2 over (x, y, yaw) of a motion about the pivot, a's frame; a pair seen both ways counts
  // twice.
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  double rms_radius_m = 0.0;  // of the paired points about the pivot
  std::size_t pairs = 0;
};

// Which stages to run: all from a start of a few decimetres, or the last one from a minimum already found.
enum class AlignStages { kCoarseToFine, kFineOnly };

// The pose at the closest minimum; `pairs` is 0 when too little of the surfaces can be paired.
[[nodiscard]] Alignment align_surfaces(const SurfaceIndex& a, const SurfaceIndex& b, const Pose2& start,
                                       AlignDirection direction, AlignStages stages);

}  // namespace submapd::internal
