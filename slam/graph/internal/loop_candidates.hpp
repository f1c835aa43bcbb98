// Which pairs of sub-maps are worth a branch-and-bound run, most informative first (design notes, section 10).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"

namespace submapd::graph {

// Places nearer to each other than this are one place: two looks at it are not two witnesses.
inline constexpr double kApartM = 5.0;

struct LoopCandidate {
  std::uint32_t a = 0;  // a < b
  std::uint32_t b = 0;
  MatchPrior prior;
  Eigen::Vector3d window = Eigen::Vector3d::Zero();  // half widths, m, m, rad
  double value = 0.0;  // expected information gain, weighed by the share of the smaller sub-map that overlaps
};

// Information gained about a relative pose of that covariance by a good match, in nats: ½ log det(I + Σ Σ_match⁻¹).
[[nodiscard]] double information_gain(const Eigen::Matrix3d& covariance);

// Half widths in which the matcher seeks for a prior of that covariance: 3 sigma within its limits.
[[nodiscard]] Eigen::Vector3d search_window(const Eigen::Matrix3d& covariance);

// Partners of b among the earlier retained sub-maps: not its neighbour, no key-frame in common, within 3 sigma an
// overlap that could be verified, and a relative pose that is not known well already. Best first; ties by index.
// `min_gap`: least difference of the indices. `skip` says by index and predicted pose (a_from_b) which partners need
// not be looked at. REQUIRES: b is retained.
[[nodiscard]] std::vector<LoopCandidate> rank_candidates(const GraphModel& model, const PairTools& tools,
                                                         const RelativeUncertainty& uncertainty, std::uint32_t b,
                                                         std::uint32_t min_gap,
                                                         const std::function<bool(std::uint32_t, const Pose2&)>& skip);

}  // namespace submapd::graph
