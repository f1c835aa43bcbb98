// The graph while the cart rolls: sub-map poses and landmarks, rows pre-composed into the sub-map frames (notes 11.1).
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/least_squares.hpp"

namespace submapd::graph {

// Covariance of a landmark in a sub-map that is taken as rigid: what it bends inside (2 cm over both sides) is added.
[[nodiscard]] Eigen::Matrix2d live_covariance(const Eigen::Matrix2d& covariance);

// What a link's edge and its landmarks count each.
[[nodiscard]] double link_scale(const ChainLink& link);

// Rows: link edges; landmarks of linked neighbours; landmarks of confirmed loops, or an edge each without
// GraphParts::landmark_rows; edges that stand for condensed sub-maps, which have no rows of their own. Where neighbours
// have both, each counts half, for they rest on partly the same scans (notes 11.2). Pending loops have no row.
[[nodiscard]] LeastSquaresGraph build_live_graph(const GraphModel& model);

// Solves from the present poses and stores the result in them. `news`: loops confirmed since the last solve; where one
// of them calls for a jump, its closure is first spread over the chain if that lowers the cost. `cancelled`:
// SolveOptions.
Expected<SolveSummary> solve_live(GraphModel& model, const std::vector<std::size_t>& news,
                                  const std::atomic<bool>* cancelled = nullptr);

// Poses with the closure of `record` spread over the sub-maps between its two, in proportion to the links' covariances;
// what comes after follows rigidly. Heading first, then what is left of the translation.
[[nodiscard]] std::vector<Pose2> spread_closure(const GraphModel& model, const LoopRecord& record);

}  // namespace submapd::graph
