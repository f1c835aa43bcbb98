// Equation (5) of the paper, literally: track points x_i and landmarks l_j, chained by f(x_i, z_i) and tied by z_ij.
//
//   X*, L* = arg min Σ ‖(x_i⁻¹ ∘ x_i+1) ⊖ f_i‖²_Ω + Σ ρ(‖R_iᵀ(l_j - t_i) - z_ij‖²_Ω)
//
// A key-frame that lies in two sub-maps is one variable. What keeps a sub-map in shape are its steps, which
// are far surer than a landmark.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/least_squares.hpp"
#include "slam/graph/internal/track_chains.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd::graph {

// Vertex ids of graph.g2o: the remainder by four tells the kind, the quotient which one.
[[nodiscard]] inline std::uint64_t track_point_id(std::uint64_t scan_index) {
  return 4 * scan_index;
}
[[nodiscard]] inline std::uint64_t submap_id(std::uint32_t index) {
  return 4 * std::uint64_t{index} + 1;
}
[[nodiscard]] inline std::uint64_t landmark_id(std::size_t number) {
  return 4 * std::uint64_t{number} + 2;
}

inline constexpr std::uint32_t kNoTrackPoint = std::numeric_limits<std::uint32_t>::max();

// Rows of the whole problem before whitening: they are both solved and exported.
struct TrackGraph {
  struct SightRow {
    std::uint32_t track_point = 0;
    std::uint32_t landmark = 0;
    Eigen::Vector2d z = Eigen::Vector2d::Zero();
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // doubled for rows of neighbouring sub-maps (notes 11.2)
  };
  std::vector<OptimizedKeyframe> track;  // ascending scan_index; the first is fixed
  std::vector<Eigen::Vector2d> landmarks;
  std::vector<ChainRow> chain;
  std::vector<SightRow> sights;
  // Index into track of each sub-map's first key-frame; condensed ones have none (hang_condensed()).
  std::vector<std::uint32_t> first_of_submap;
};

// Rows of landmarks that a graph has at most: they take memory while it is solved.
inline constexpr std::size_t kMostSights = 24'000;

// Values from the live poses. Rows from links, landmarks of linked neighbours, confirmed loops (an edge each without
// GraphParts::landmark_rows), and edges that stand for condensed sub-maps. Above kMostSights (up to what rounding adds
// for a pair) landmarks are thinned.
[[nodiscard]] TrackGraph build_track_graph(const GraphModel& model);

// Solves in place, up to 50 iterations, without the track points that only pass the chain on (TrackChains).
// `robust_loss`: GraphParts; `cancelled`: SolveOptions.
Expected<SolveSummary> solve_track_graph(TrackGraph& graph, bool robust_loss = true,
                                         const std::atomic<bool>* cancelled = nullptr);

// Vertices and edges with the graph's present values; a sub-map's vertex hangs on its first key-frame by an identity
// edge.
[[nodiscard]] GraphExport export_graph(const TrackGraph& graph);

}  // namespace submapd::graph
