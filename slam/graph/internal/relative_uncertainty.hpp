// How uncertain the relative pose of two sub-maps is at most, without the graph's factor (design notes, section 10).
//
// Covariances are compounded along the best chain of edges (Dijkstra): one path leaves out what the others would add,
// so the bound is conservative. Edges are the links between neighbours and the confirmed loops.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "slam/graph/internal/graph_model.hpp"

namespace submapd::graph {

struct RelativePose {
  UncertainPose pose;         // a_from_b as the graph has it now, with the bound
  bool through_loop = false;  // the path uses a confirmed loop
};

// Valid for the model as it was when it was built; keeps a reference to it.
class RelativeUncertainty {
 public:
  explicit RelativeUncertainty(const GraphModel& model);

  // One pair; the paths of every `a` asked for are remembered. REQUIRES: a and b are indices of sub-maps.
  [[nodiscard]] const RelativePose& between_submaps(std::uint32_t a, std::uint32_t b);
  // start_from_k for every sub-map k, not remembered. REQUIRES: the index of a sub-map.
  [[nodiscard]] std::vector<RelativePose> paths_from(std::uint32_t start) const;

 private:
  struct Edge {
    std::uint32_t to;
    Eigen::Matrix3d covariance;  // of here_from_to
    bool loop;
  };

  const GraphModel& model_;
  std::vector<std::vector<Edge>> edges_;
  std::map<std::uint32_t, std::vector<RelativePose>> known_;
};

}  // namespace submapd::graph
