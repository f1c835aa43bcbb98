// report.json of a replay: what a saved map's report says (daemon/saved-map.md), and what a benchmark needs to judge
// the graph against a truth: where each sub-map came to lie, and every confirmed loop as it was matched.
#pragma once

#include <filesystem>

#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/output/run_quality.hpp"

namespace submapd::tools {

// The file appears whole or not at all. Poses are [x m, y m, yaw rad], covariances of those the upper triangle in row
// order. "submaps": stamp of the first key-frame, pose in the map, bound of its covariance relative to the first
// sub-map. "matches": of each confirmed loop sub-maps a and b, b's pose in a's frame, its covariance, both ones'
// overlap. "links": of neighbours the same as the chain has it, without the overlap. "end": the last key-frame's stamp,
// pose in the map, and the bound of its covariance relative to the start.
[[nodiscard]] Status write_replay_report(const std::filesystem::path& path, const RunQuality& quality,
                                         const FinalResult& result);

}  // namespace submapd::tools
