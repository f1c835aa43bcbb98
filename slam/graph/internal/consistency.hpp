// Do two loops tell the same story? Pairwise consistency and its largest clique (PCM; Mangelson et al. 2018;
// notes 11.4).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd::graph {

inline constexpr double kChi2Agree = 11.34;     // three degrees of freedom, 99 %
inline constexpr double kChi2Conflict = 16.27;  // 99.9 %

// A test of one pose against another and what it is worth.
struct Consistency {
  double mahalanobis2 = 0.0;
  // Share of the search window that would have passed: the chance that a placement drawn from it agrees by accident.
  // A gate as wide as the window proves nothing, however small the distance.
  double chance = 1.0;

  [[nodiscard]] bool agrees(double max_chance) const { return mahalanobis2 < kChi2Agree && chance <= max_chance; }
  [[nodiscard]] bool conflicts(double max_chance) const { return mahalanobis2 > kChi2Conflict && chance <= max_chance; }
};

// `error` should be zero up to `covariance`; `window` are the half widths (m, m, rad) the placement was sought in.
[[nodiscard]] Consistency judge(const Pose2& error, const Eigen::Matrix3d& covariance, const Eigen::Vector3d& window);

// Loops z_ik and z_jl with the graph's x_ij and x_lk: the cycle z_ik⁻¹ ∘ x_ij ∘ z_jl ∘ x_lk, its covariance to first
// order.
[[nodiscard]] Consistency judge_cycle(const UncertainPose& z_ik, const UncertainPose& x_ij, const UncertainPose& z_jl,
                                      const UncertainPose& x_lk, const Eigen::Vector3d& window);

// Largest set of mutually agreeing members, ascending; of equal ones the first in lexicographic order of discovery.
// Exact up to 60 vertices unless an internal budget of steps ends the search with the best so far; greedy beyond.
// `agree` is symmetric, its diagonal ignored.
[[nodiscard]] std::vector<std::size_t> largest_clique(const std::vector<std::vector<bool>>& agree);

}  // namespace submapd::graph
