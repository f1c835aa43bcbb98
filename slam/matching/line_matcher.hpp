// Stage 2: point-to-line on pooled surface statistics, sub-cell (design notes 5.2), and the degeneracy test on its
// Hessian.
#pragma once

#include <span>

#include "slam/grid/surface_map.hpp"
#include "slam/matching/match_types.hpp"
#include "slam/matching/scan_points.hpp"

namespace submapd {

// Which lines of the surface map.
enum class LinesOf {
  kCell,          // the best there is: what the cart is aligned to
  kNeighbourhood  // always pooled over 3 x 3 cells: their normals err less, which counts where normals are judged
};

struct LineMatcherOptions {
  LinesOf lines = LinesOf::kCell;
  int max_iterations = 4;
  double range_sigma_m = 0.012;     // sigma_r of one range
  double beam_sigma_steps = 0.25;   // sigma of a beam's direction in angle steps
  double min_line_sigma_m = 0.003;  // no pooled line is known better
  double gate_m = 0.10;             // association gate, or three sigma where that is less ...
  double min_gate_m = 0.04;         // ... but not below this
  double tangential_gate_m = 0.15;  // beyond the end of the mapped part of a wall
  double cauchy_sigmas = 2.0;
  double kappa = 8.0;
  double facing = 0.25;    // share of a weak motion that moves the wall across itself: more than normals err
  int standing_scans = 2;  // hit by fewer, it may be a person who walks, and tells nothing along a weak axis
  double stop_m = 0.0002;
  double stop_rad = 0.00005;
};

struct LineMatchResult {
  MatchResult match;
  int associated = 0;  // points that found a surface
};

// Refines `start` against the surfaces. Thread-safe while nobody inserts.
[[nodiscard]] LineMatchResult match_lines(std::span<const ScanPoint> points, const SurfaceMap& surface,
                                          double angle_step_rad, const Pose2& start, const MotionPrior& prior,
                                          const LineMatcherOptions& options);

// The system at one pose, without moving it: its translation block tells which direction the walls hold.
// With a weak motion, only walls that face it say anything about it.
struct LineSystem {
  NormalEquations equations;
  int associated = 0;
  double axial_information = 0.0;  // about the weak motion [1/m^2], 0 without one
};
[[nodiscard]] LineSystem line_system(std::span<const ScanPoint> points, const SurfaceMap& surface,
                                     double angle_step_rad, const Pose2& pose, const WeakMotion& weak,
                                     const LineMatcherOptions& options);

}  // namespace submapd
