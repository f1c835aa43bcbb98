// Takes sub-maps out of the graph and leaves edges: how the graph stays bounded (design section 5).
//
// A sub-map k with ties to its neighbours i is eliminated. Exactly, that would tie every neighbour to every other. Kept
// is the tree nearest to that (Chow and Liu 1968; for pose graphs Kretzschmar and Stachniss 2012): the neighbour that k
// is tied to best, its hub r, takes over k's ties, each as r_from_i = (k_from_r)⁻¹ ∘ k_from_i with the compounded
// covariance. Of those, the ones that are no better than the way there is already are left out, so that the edges stay
// as sparse as the site. Means are the graph's present estimates: what is retained stays where it is.
//
// k itself hangs rigidly on r from then on: its pose, its first key-frame and the middle one stay in memory, and
// nothing else. A rigid sub-map is most true in its middle, for it is placed by all of its ties: there it carries the
// trajectory, and there edges hold on to the final graph, in which sub-maps bend. After a break the trajectory needs
// the first.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "slam/graph/internal/coverage.hpp"
#include "slam/graph/internal/graph_model.hpp"

namespace submapd::graph {

struct Condensed {
  std::uint32_t submap = 0;
  SubmapState state = SubmapState::kCondensed;
  std::uint32_t confirmed_loops = 0;  // that are gone with it
  std::uint32_t pending_loops = 0;
};

// For as long as nobody else changes the model.
class Condenser {
 public:
  explicit Condenser(GraphModel& model);

  // Condenses one sub-map: of those whose area others know and that are tied well the one known most often, of equal
  // ones the oldest; if there is none, the oldest of all. Never the first, which is the gauge, nor the newest: a dozen
  // of them, or three when all others are gone. Nothing if none is left.
  std::optional<Condensed> step();

 private:
  using Pair = std::pair<std::uint32_t, std::uint32_t>;  // (a, b), a < b
  struct PairTie {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // of a_from_b, as the rows of the live graph have it
    bool loop = false;
  };
  struct Spoke {
    std::uint32_t to = 0;
    UncertainPose k_from_to;
    bool loop = false;
  };

  void tie(std::uint32_t a, std::uint32_t b, const Eigen::Matrix3d& information, bool loop);
  [[nodiscard]] UncertainPose a_from_b(const Pair& pair) const;
  [[nodiscard]] std::vector<Spoke> spokes_of(std::uint32_t k) const;
  [[nodiscard]] std::optional<std::uint32_t> redundant() const;
  [[nodiscard]] std::optional<std::uint32_t> oldest() const;
  Condensed condense(std::uint32_t k, SubmapState state);
  void take_over(const Spoke& hub, const std::vector<Spoke>& spokes);

  GraphModel& model_;
  Coverage coverage_;
  std::map<Pair, PairTie> ties_;
};

// Index of the key-frame in the middle. REQUIRES: a key-frame.
[[nodiscard]] std::size_t middle_of(const SubmapRecord& record);

// Gives the condensed sub-maps of a result their poses, bounds, vertices and a key-frame each, by those of their hubs.
// REQUIRES: `result` holds an entry for each sub-map, those of retained ones solved.
void hang_condensed(const GraphModel& model, FinalResult& result);

}  // namespace submapd::graph
