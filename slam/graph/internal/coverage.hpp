// Which parts of the site the retained sub-maps know, and how often: who is redundant.
//
// One raster of the outlines' coarse cells over the map as the graph has it now. Taken when the graph is to shrink and
// dropped afterwards: some 6 bytes a coarse cell of each retained sub-map.
#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "slam/graph/internal/graph_model.hpp"

namespace submapd::graph {

class Coverage {
 public:
  // Of the model's retained sub-maps at its present poses.
  explicit Coverage(const GraphModel& model);

  // How many other sub-maps know each place that this one knows, but for the fiftieth part that is known least.
  // REQUIRES: retained when the raster was taken, and not removed since.
  [[nodiscard]] std::uint32_t redundancy(std::uint32_t submap) const;
  void remove(std::uint32_t submap);

 private:
  std::unordered_map<std::uint64_t, std::uint32_t> cell_at_;  // place to cell
  std::vector<std::uint32_t> known_to_;                       // by cell: how many sub-maps
  std::vector<std::vector<std::uint32_t>> cells_of_;          // by sub-map, each once
};

}  // namespace submapd::graph
