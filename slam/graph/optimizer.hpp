// The back end in one object: finished sub-maps in, optimised sub-map poses, loops and the final graph out.
//
// Algorithms only: no thread, message or file of its own. The optimizer thread of the daemon, or replay, owns one and
// calls it from one thread. Deterministic: work is budgeted in candidates and iterations, never in time.
//
// Live graph: sub-map poses S_a and virtual landmarks, observations pre-composed into the sub-map's frame (design
// notes 11.1). Final graph: equation (5) of the paper, track points and landmarks.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "slam/landmark/landmark.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/submap/finished_submap.hpp"
#include "slam/submap/submap_source.hpp"

namespace submapd {

enum class LoopState : std::uint8_t { kPending, kConfirmed, kRejected };

struct Loop {
  SubmapMatch match;
  LoopState state = LoopState::kPending;
  bool manual = false;  // a person's tie: the match is what its points say
};

// A spot that somebody has found in two sub-maps.
struct TiePoint {
  Eigen::Vector2d in_a = Eigen::Vector2d::Zero();  // m, in a's frame
  Eigen::Vector2d in_b = Eigen::Vector2d::Zero();  // m, in b's frame
  friend bool operator==(const TiePoint&, const TiePoint&) = default;
};

// Landmarks between two sub-maps that a person vouches for (design notes, section 12).
struct ManualTie {
  std::uint32_t a = 0;  // a < b
  std::uint32_t b = 0;
  double sigma_m = 0.1;  // of a spot's place in either sub-map, a side
  std::vector<TiePoint> points;
  friend bool operator==(const ManualTie&, const ManualTie&) = default;
};

// What a person has decided about a run's graph.
struct GraphEdits {
  std::vector<ManualTie> ties;                                  // one a pair; at least two points each
  std::vector<std::pair<std::uint32_t, std::uint32_t>> barred;  // (a, b), a < b: no loop is sought between them
};

// [experiment]: parts that are switched off to show what they are worth.
struct GraphParts {
  bool landmark_rows = true;         // false: a confirmed loop is one relative-pose edge with its covariance
  bool contradiction_test = true;    // false: a match may contradict free space
  bool pairwise_consistency = true;  // false: a loop that the graph does not contradict needs no other one that agrees
  bool robust_loss = true;           // false: the final graph is solved by plain squares
};

struct OptimizerOptions {
  bool loops = true;  // false: adjacent sub-maps only (replay --no-loops)
  GraphParts parts = {};
  // Ties hold from the moment both sub-maps are there, and no policy takes them back.
  GraphEdits edits = {};
  bool suspects = false;  // finish() looks for them
  // Near it sub-maps are condensed: first those whose area others know, oldest first; then, because mapping never stops
  // for memory, the oldest. What of landmarks or of a loop would still pass it is refused. What a condensed sub-map
  // leaves (some 300 bytes) is always kept, and the newest few sub-maps are, too.
  std::size_t graph_bytes_limit = 6U << 20;
};

// What the optimizer counted; all monotonic but `bytes_used`.
struct OptimizerCounters {
  std::uint64_t submaps = 0;
  std::uint64_t landmarks = 0;           // in the graph now
  std::uint64_t loop_candidates = 0;     // branch-and-bound runs
  std::uint64_t submaps_condensed = 0;   // of them, hung on another that is retained; their area is known to others
  std::uint64_t submaps_frozen = 0;      // of them, hung on another for want of memory although they alone know a place
  std::uint64_t loops_confirmed = 0;     // state now, and of condensed sub-maps
  std::uint64_t loops_pending = 0;       // state now
  std::uint64_t loops_rejected = 0;      // candidates and pending loops that were refused, or fell with a condensed one
  std::uint64_t refused_for_memory = 0;  // sets of landmarks that would have passed graph_bytes_limit
  std::uint64_t solves = 0;
  double solve_ms_max = 0.0;  // wall time, for the report only: nothing depends on it
  std::size_t bytes_used = 0;
  std::size_t bytes_peak = 0;
};

enum class SubmapState : std::uint8_t {
  kRetained,   // part of the graph
  kCondensed,  // hangs rigidly on a retained one, whose area and that of others covers its own: not drawn
  kFrozen,     // the same, but it alone knows some place: drawn, and no longer found again by loops
};

struct SubmapPose {
  std::uint32_t index = 0;
  Pose2 map_from_submap;
  SubmapState state = SubmapState::kRetained;
};

// State after a live solve: what CART_GRAPH carries and what corrects the pose in the map.
struct GraphState {
  std::uint32_t version = 0;        // grows by one with each solve
  std::vector<SubmapPose> submaps;  // in order of index
  std::vector<Loop> loops;          // between retained ones, in order of discovery
};

struct GraphPose {  // VERTEX_SE2
  std::uint64_t id = 0;
  Pose2 pose;
};
struct GraphPoint {  // VERTEX_XY
  std::uint64_t id = 0;
  Eigen::Vector2d point = Eigen::Vector2d::Zero();
};
struct GraphPoseEdge {  // EDGE_SE2
  std::uint64_t from = 0;
  std::uint64_t to = 0;
  Pose2 measurement;  // from⁻¹ ∘ to
  Eigen::Matrix3d information = Eigen::Matrix3d::Identity();
};
struct GraphPointEdge {  // EDGE_SE2_XY
  std::uint64_t from = 0;
  std::uint64_t to = 0;
  Eigen::Vector2d measurement = Eigen::Vector2d::Zero();
  Eigen::Matrix2d information = Eigen::Matrix2d::Identity();
};

// The graph as it is written to graph.g2o, values optimised.
struct GraphExport {
  std::vector<GraphPose> poses;
  std::vector<GraphPoint> points;
  std::vector<GraphPoseEdge> pose_edges;
  std::vector<GraphPointEdge> point_edges;
  std::vector<std::uint64_t> fixed;
};

// A track point's pose in the map after the final solve.
struct OptimizedKeyframe {
  std::uint64_t scan_index = 0;
  std::int64_t stamp_us = 0;
  Pose2 map_from_base;
};

// How uncertain a sub-map's place in the map is at most: along the best chain of edges from the first sub-map.
struct SubmapBound {
  std::int64_t begun_us = 0;                             // its first key-frame
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of map_from_submap (x, y, yaw), in the map's frame
};

// A tie of the graph and how much the solution strains it.
struct TieStress {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  bool link = false;  // between neighbours; else a confirmed loop
  bool manual = false;
  Pose2 a_from_b;                                        // by the tie
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of it, in a's frame
  double off_m = 0.0;                                    // where b is and where the tie has it, at b's origin
  double sigmas = 0.0;                                   // Mahalanobis distance of the whole relative pose
};

// A pair of sub-maps that a person should look at.
struct SuspectPair {
  enum class Kind : std::uint8_t {
    kUntied,    // may overlap, is not known well, and no match was accepted
    kPending,   // a match that nothing else agrees with; or that contradicts the rest
    kStrained,  // a tie that the solution does not keep
  };
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  Kind kind = Kind::kUntied;
  double effect_m = 0.0;   // how far b may move relative to a: one sigma if untied, else what the match says
  double gain_nats = 0.0;  // what a good match would add to what is known of their relative pose
  double sigmas = 0.0;     // of a match: how far it is from the graph
};

struct FinalResult {
  std::vector<SubmapPose> submaps;  // in order of index
  std::vector<SubmapBound> bounds;  // by sub-map
  // In order of time: every distinct track point of the retained sub-maps, of others one at least. Whoever wants
  // the rest goes on by the filter's own steps (OptimizedTrajectory).
  std::vector<OptimizedKeyframe> keyframes;
  std::vector<Loop> loops;
  GraphExport graph;                  // equation (5)
  std::string report;                 // a few lines for people: residuals before and after, iterations
  std::vector<TieStress> ties;        // links and confirmed loops between retained sub-maps
  std::vector<SuspectPair> suspects;  // largest effect first; only if OptimizerOptions::suspects
};

// Bound of the covariance (x, y, yaw) of a pose in the map at an instant: that of the newest sub-map begun by then,
// carried to the pose. What is left out, the pose within its sub-map, is a few millimetres. Zero if the result has
// none.
[[nodiscard]] Eigen::Matrix3d covariance_bound(const FinalResult& result, std::int64_t stamp_us,
                                               const Pose2& map_from_base);

// What the optimizer thread drives: the Optimizer below, or a double in tests.
class BackEnd {
 public:
  BackEnd() = default;
  BackEnd(const BackEnd&) = delete;
  BackEnd& operator=(const BackEnd&) = delete;
  virtual ~BackEnd() = default;

  // Takes the next finished sub-map (indices 0, 1, 2, ... in order), matches it with its neighbours, seeks loops,
  // solves.
  virtual Expected<GraphState> add_submap(const std::shared_ptr<const FinishedSubmap>& submap) = 0;

  // Remaining loop search over all overlapping pairs, then equation (5) to convergence.
  virtual Expected<FinalResult> finish() = 0;

  // About what finish() would give if `open`, a sub-map that is still growing, were the last one. Seeks a few dozen
  // loops at most, because somebody waits; those of finished sub-maps stay in the graph that lives on, the rest is a
  // copy's.
  virtual Expected<FinalResult> finish_with(const std::shared_ptr<const FinishedSubmap>& open) = 0;

  [[nodiscard]] virtual OptimizerCounters counters() const = 0;

  // Any thread: what is worked on and what comes later ends soon, with kUnavailable. For the end of the program.
  virtual void cancel() {}
};

struct PairTools;  // slam/graph/internal/pair_tools.hpp

class Optimizer : public BackEnd {
 public:
  // `source` must outlive the optimizer; the sub-map just added can already be loaded from it.
  Optimizer(const OptimizerOptions& options, SubmapSource& source);
  // With another matcher and choice of landmarks than the default ones: for tests.
  Optimizer(const OptimizerOptions& options, SubmapSource& source, PairTools tools);
  ~Optimizer() override;

  Expected<GraphState> add_submap(const std::shared_ptr<const FinishedSubmap>& submap) override;
  Expected<FinalResult> finish() override;
  Expected<FinalResult> finish_with(const std::shared_ptr<const FinishedSubmap>& open) override;
  [[nodiscard]] OptimizerCounters counters() const override;
  void cancel() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace submapd
