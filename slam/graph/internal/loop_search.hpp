// Runs the matcher on pairs of sub-maps, makes pending loops of what it accepts, and remembers what was tried.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/loop_candidates.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/submap/submap_source.hpp"

namespace submapd::graph {

class LoopSearch {
 public:
  // Both must outlive the search.
  LoopSearch(const PairTools& tools, SubmapSource& source) : tools_(tools), source_(source) {}
  // Knows what `other` knows and works with other tools and another source.
  LoopSearch(const LoopSearch& other, const PairTools& tools, SubmapSource& source);

  // The pairs of b worth a run now: informative ones not tried yet, or tried in a window the prior has left since.
  [[nodiscard]] std::vector<LoopCandidate> untried(const GraphModel& model, const RelativeUncertainty& uncertainty,
                                                   std::uint32_t b, std::uint32_t min_gap) const;

  // At most `count` of `ranked`, apart from each other if there is a choice: two matches at one spot teach little more
  // than one.
  [[nodiscard]] static std::vector<LoopCandidate> spread_out(const GraphModel& model,
                                                             const std::vector<LoopCandidate>& ranked,
                                                             std::size_t count);

  // One matcher run; a match with at least two landmarks becomes a pending loop if it fits in `bytes_left`.
  void run(GraphModel& model, const LoopCandidate& candidate, std::size_t bytes_left);

  // Landmarks between the neighbours `newest` - 1 and `newest`, from a refinement of the link's pose.
  [[nodiscard]] std::vector<VirtualLandmark> tie_neighbours(const GraphModel& model,
                                                            const std::shared_ptr<const FinishedSubmap>& newest,
                                                            std::size_t bytes_left);

  // The sub-map is never searched again.
  void forget(std::uint32_t submap);
  // The pair is never searched at all.
  void bar(std::uint32_t a, std::uint32_t b) { barred_.insert({a, b}); }
  [[nodiscard]] bool is_barred(std::uint32_t a, std::uint32_t b) const { return barred_.contains({a, b}); }

  // Nothing will be searched for a while: the views kept for it may go.
  void release() { views_.clear(); }

  [[nodiscard]] std::uint64_t runs() const { return runs_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] std::uint64_t refused_for_memory() const { return refused_for_memory_; }
  [[nodiscard]] std::uint64_t load_failures() const { return load_failures_; }
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct KeptView {
    std::shared_ptr<const FinishedSubmap> submap;
    SubmapView view;
  };

  // Null if it cannot be loaded. Good until the next but one.
  [[nodiscard]] const SubmapView* view_of(std::uint32_t index);
  const SubmapView* keep_view(const std::shared_ptr<const FinishedSubmap>& submap);

  const PairTools& tools_;
  SubmapSource& source_;
  std::map<std::pair<std::uint32_t, std::uint32_t>, Pose2> tried_;  // where the prior was
  std::set<std::pair<std::uint32_t, std::uint32_t>> barred_;
  std::list<KeptView> views_;  // latest use first; at most kViewBytes, but two always
  std::uint64_t runs_ = 0;
  std::uint64_t refused_ = 0;
  std::uint64_t refused_for_memory_ = 0;
  std::uint64_t load_failures_ = 0;
};

}  // namespace submapd::graph
