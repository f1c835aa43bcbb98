// Trials of loops between sub-maps of one run whose true places are known: what the product makes of two stretches of
// the run if all that the graph knows of their relative pose is a prior that is off by a random error.
//
// A trial's graph has four sub-maps, a - 1, a, b and b + 1, with the chain links the run gives them; the prior is the
// link from a to b. The loop search looks at the pairs that its ranking lets in, and the loop policy confirms as at the
// end of a run. So "accepted" is what the matcher says of (a, b) alone, "confirmed" what would bend the map: a match
// that another pair agrees with, or one that is strong, alone, under a tight prior. All of it is the library's own
// code.
//
// Deterministic: same run, options and number, same trial. One thread.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/loop/submap_matcher.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd::bench {

// A match farther than either from the truth is false (slam_bench/metrics.py has the same limits).
inline constexpr double kFalse_m = 0.3;
inline constexpr double kFalse_rad = 2.0 * graph::kDegree;

enum class TrialKind : std::uint8_t {
  kOverlapping,  // 25 m^2 or more are known to both
  kApart,        // less; the prior's covariance lets the pair in all the same
  kDeceived,     // as apart, and the prior lies about a place that looks alike: its covariance is a lie
};
inline constexpr int kTrialKinds = 3;

struct TrialOptions {
  std::uint64_t seed = 1;
  // Translations in the world, m, that carry the building, or its grid, onto itself, as far as its plan goes. Sums of
  // up to twice each count.
  std::vector<Eigen::Vector2d> aliases;
};

// What is known of a run. Vectors of one length, by index of the sub-map.
struct TrialRun {
  std::uint64_t number = 0;  // of the run among others: its trials are drawn independently
  std::vector<std::shared_ptr<const FinishedSubmap>> submaps;
  std::vector<Pose2> world_from_submap;  // true
};

struct Trial {
  TrialKind kind = TrialKind::kOverlapping;
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  Pose2 a_from_b;    // true
  MatchPrior prior;  // drawn about it, or about its double
  double sigma_m = 0.0;
  double sigma_rad = 0.0;
  double overlap_m2 = 0.0;  // in truth
  double structure = 0.0;   // of what both know, in truth: see structure_of()
  // The place is one of its kind: it overlaps, its walls fix both directions, and none of the world's doubles of it
  // lies in the search window.
  bool unambiguous = false;
};

struct WrongLoop {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  double off_m = 0.0;
  double off_rad = 0.0;
};

struct TrialResult {
  SubmapMatch match;  // of (a, b)
  double off_m = 0.0;
  double off_rad = 0.0;
  bool accepted = false;
  bool confirmed = false;                  // (a, b) itself
  std::uint32_t loops_confirmed = 0;       // of the trial's graph
  std::vector<WrongLoop> wrong_confirmed;  // of them
};

[[nodiscard]] bool is_false(const Pose2& true_a_from_b, const Pose2& a_from_b);

// How well walls fix a place: over the line-like surface of b that lies where a knows its cells, the smaller eigenvalue
// of the normals' sum of squares over the larger. 0: parallel walls only; 1: as much across as along.
[[nodiscard]] double structure_of(const FinishedSubmap& b, const SubmapOutline& a, const Pose2& a_from_b);

// Whether one of the world's doubles of b's true place lies within the window about the prior.
[[nodiscard]] bool alias_in_window(const std::vector<Eigen::Vector2d>& aliases, const Pose2& world_from_a,
                                   const Pose2& world_from_b, const MatchPrior& prior);

class TrialGround {
 public:
  TrialGround(TrialRun run, TrialOptions options);

  // The trial of that number, or nothing if the run has no pair for it.
  [[nodiscard]] std::optional<Trial> draw(TrialKind kind, std::uint64_t number) const;
  [[nodiscard]] TrialResult run(const Trial& trial) const;

  [[nodiscard]] std::size_t pairs(TrialKind kind) const { return pairs_[static_cast<std::size_t>(kind)].size(); }
  [[nodiscard]] const TrialRun& ground() const { return run_; }

 private:
  struct Pair {
    std::uint32_t a = 0;
    std::uint32_t b = 0;
    Pose2 seen_at;  // a_from_b that priors are drawn about
    double overlap_m2 = 0.0;
  };
  [[nodiscard]] graph::GraphModel graph_of(std::uint32_t a, std::uint32_t b, const MatchPrior& prior) const;
  [[nodiscard]] bool is_asked(std::uint32_t a, std::uint32_t b, const MatchPrior& prior) const;
  void sort_pair(std::uint32_t a, std::uint32_t b);

  TrialRun run_;
  TrialOptions options_;
  PairTools tools_ = default_pair_tools({});
  std::vector<graph::SubmapRecord> records_;
  std::vector<graph::ChainLink> links_;  // to the sub-map before
  std::array<std::vector<Pair>, kTrialKinds> pairs_;
};

}  // namespace submapd::bench
