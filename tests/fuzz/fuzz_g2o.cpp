// read_g2o() on any bytes: no crash, and what it accepts hangs together.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string>

#include "slam/output/g2o_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  const auto graph = submapd::read_g2o(in, "fuzz");
  if (!graph) return 0;
  if (graph->poses.empty() && (!graph->pose_edges.empty() || !graph->point_edges.empty())) std::abort();
  for (const submapd::GraphPoseEdge& edge : graph->pose_edges) {
    if (!edge.information.allFinite() || edge.information != edge.information.transpose()) std::abort();
  }
  return 0;
}
