// A sparse least-squares problem over poses and points, and its solver; the only place that knows Ceres.
//
// Both graphs come down to it: sub-map poses with landmarks while live, track points with landmarks at the end.
// Levenberg-Marquardt, landmarks seen twice eliminated first, one thread, stopped by iterations: same input, same bits.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd::graph {

struct PoseRow {
  std::uint32_t from = 0;  // index into poses
  std::uint32_t to = 0;
  Pose2 measurement;  // from⁻¹ ∘ to
  Eigen::Matrix3d whitening = Eigen::Matrix3d::Identity();
};

struct PointRow {
  std::uint32_t pose = 0;                                 // index into poses
  std::uint32_t point = 0;                                // index into points
  Eigen::Vector2d measurement = Eigen::Vector2d::Zero();  // of the point in the pose's frame, m
  Eigen::Matrix2d whitening = Eigen::Matrix2d::Identity();
};

struct LeastSquaresGraph {
  std::vector<Pose2> poses;  // poses[0] is held constant: it fixes the gauge
  std::vector<Eigen::Vector2d> points;
  std::vector<PoseRow> pose_rows;    // plain least squares
  std::vector<PointRow> point_rows;  // under a Cauchy loss
};

struct SolveOptions {
  int max_iterations = 10;
  double cauchy_scale = 1.0;                     // whitened residual at which a landmark row begins to lose weight
  const std::atomic<bool>* cancelled = nullptr;  // looked at between iterations; may be null
};

struct SolveSummary {
  double initial_cost = 0.0;  // half the sum of squares, robustified
  double final_cost = 0.0;
  int iterations = 0;
};

// W with WᵀW = scale * covariance⁻¹; nothing if the covariance is not finite and positive definite.
[[nodiscard]] std::optional<Eigen::Matrix3d> whitening(const Eigen::Matrix3d& covariance, double scale = 1.0);
[[nodiscard]] std::optional<Eigen::Matrix2d> whitening(const Eigen::Matrix2d& covariance, double scale = 1.0);

// The same, but for a covariance that will not do that of a break (10 m, 1 rad): a track is never cut by a bad number.
[[nodiscard]] Eigen::Matrix3d whitening_or_soft(const Eigen::Matrix3d& covariance, double scale = 1.0);

// Half the robust sum of squares at the present values, as solve() sees it.
[[nodiscard]] double cost(const LeastSquaresGraph& graph, double cauchy_scale);

// Moves poses and points to a minimum near by. On failure they are left as they were. A point with just two rows, from
// two poses, is eliminated beforehand, with the covariances turned as the poses are at the start, and comes out where
// the solved poses have it: the factor is that of the poses tied. kUnavailable when `cancelled` is set.
// REQUIRES: at least one pose, every index within its vector.
Expected<SolveSummary> solve(LeastSquaresGraph& graph, const SolveOptions& options);

}  // namespace submapd::graph
