// What a finished run leaves behind: trajectory, map, picture, graph (design section 7).
#pragma once

#include <filesystem>
#include <string>

#include "daemon/configuration.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/submap/submap_source.hpp"
#include "tools/replay/metrics.hpp"
#include "tools/replay/pose_spool.hpp"

namespace submapd::tools {

// References must outlive the call.
struct RunOutputs {
  std::filesystem::path folder;
  std::string name;  // of the log, for the picture's title
  const Configuration& configuration;
  const FinalResult& result;
  SubmapSource& submaps;
  PoseSpool& spool;
  ReplayMetrics& metrics;  // path_m and the map's budget are filled in
};

// Writes trajectory.tum, map.pgm, map.yaml, map.png and graph.g2o, each whole or not at all.
[[nodiscard]] Status write_run_outputs(RunOutputs& run);

}  // namespace submapd::tools
