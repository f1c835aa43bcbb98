// A log mapped in chunks by several workers (paper 2.1.1, several sub-maps at once), joined as if one had mapped it.
//
// Sub-maps are numbered through, the first of a chunk is tied to the last of the one before by the scans that both have
// mapped (seam.hpp), and all go to the optimizer in the order of the log.
#pragma once

#include <filesystem>
#include <functional>

#include "slam/output/trajectory_file.hpp"
#include "tools/replay/chunk_team.hpp"
#include "tools/replay/replay.hpp"
#include "tools/replay/submap_feed.hpp"

namespace submapd::tools {

// Where it goes. References must outlive the call.
struct MappingOutputs {
  SubmapFeed& feed;
  PoseSpool& poses;
  TrajectoryFile& filter_trajectory;
  ReplayMetrics& metrics;
  std::function<void(const ReplayProgress&)> progress;
};

// Uses the folder chunks/ below `options.folder` and removes it. The result is the same for any number of workers.
[[nodiscard]] Status map_in_chunks(ChunkTeamOptions options, const MappingOutputs& out);

}  // namespace submapd::tools
