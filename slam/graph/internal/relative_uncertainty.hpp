// How uncertain the relative pose of two sub-maps is at most, without the graph's factor (design notes, section 10).
//
// Covariances are compounded along the best chain of edges (Dijkstra): one path leaves out what the others would add,
// so the bound is conservative. Edges are the links between neighbours, the confirmed loops, and what stands for
// condensed sub-maps, which are no places on the way themselves.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "slam/graph/internal/graph_model.hpp"

namespace submapd::graph {

struct RelativePose {
  UncertainPose pose;         // a_from_b as the graph has it now, with the bound
  bool through_loop = false;  // the path uses a confirmed loop
  bool reached = false;       // there is a path
};

// Of one sub-map to all that are retained. Takes the room of those only, however many are condensed.
class RelativePoses {
 public:
  // REQUIRES: a retained sub-map.
  [[nodiscard]] const RelativePose& operator[](std::uint32_t submap) const { return by_slot_[(*slots_)[submap]]; }

 private:
  friend class RelativeUncertainty;
  std::vector<RelativePose> by_slot_;
  const std::vector<std::uint32_t>* slots_ = nullptr;
};

// What joins two sub-maps, for whoever has another opinion of the covariance than the model.
struct Tie {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of a_from_b
  bool loop = false;
};

// One number for a covariance: the mean square by which it moves a place half a sub-map away, m^2.
[[nodiscard]] double spread_m2(const Eigen::Matrix3d& covariance);

// Valid for the model as it was when it was built; keeps a reference to it.
class RelativeUncertainty {
 public:
  explicit RelativeUncertainty(const GraphModel& model);
  // With these ties instead of the model's. REQUIRES: of retained sub-maps.
  RelativeUncertainty(const GraphModel& model, const std::vector<Tie>& ties);
  RelativeUncertainty(const RelativeUncertainty&) = delete;
  RelativeUncertainty& operator=(const RelativeUncertainty&) = delete;

  // One pair; the paths of every `a` asked for are remembered. REQUIRES: a and b are retained sub-maps.
  [[nodiscard]] const RelativePose& between_submaps(std::uint32_t a, std::uint32_t b);
  // start_from_k for every retained sub-map k, not remembered; no longer valid than this object. REQUIRES: `start` is
  // retained.
  [[nodiscard]] RelativePoses paths_from(std::uint32_t start) const;

 private:
  struct Edge {
    std::uint32_t to;            // slot
    Eigen::Matrix3d covariance;  // of here_from_to
    bool loop;
  };

  void number_retained();
  void add(std::uint32_t a, std::uint32_t b, const UncertainPose& a_from_b, bool loop);

  const GraphModel& model_;
  std::vector<std::uint32_t> slots_;      // by sub-map: its place among the retained ones
  std::vector<std::uint32_t> retained_;   // by slot
  std::vector<std::vector<Edge>> edges_;  // by slot
  std::map<std::uint32_t, RelativePoses> known_;
};

}  // namespace submapd::graph
