// What a run leaves behind for people and other programs: trajectory, map, picture, graph, marks (design section 7).
//
// Written by replay when a log ends and by the daemon when a map is saved. One thread; blocks on the disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "slam/filter/mapper.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/output/run_quality.hpp"
#include "slam/submap/submap_source.hpp"

namespace submapd {

// A named instant, e.g. when a camera was triggered.
struct Mark {
  std::string name;
  std::int64_t utime_us = 0;
};

// References must outlive the call.
struct RunOutputs {
  std::filesystem::path folder;
  std::string name;      // for the picture's title
  std::string subtitle;  // small, below it
  const MapperOptions& mapper;
  std::size_t raster_bytes = 0;  // budget of the whole map
  const FinalResult& result;
  SubmapSource& submaps;
  const PoseSpool& poses;
  std::uint64_t scans = 0;  // poses to use; the key-frame of each must be part of the result
  std::vector<Mark> marks;  // in order of time
};

struct RunOutputsSummary {
  double path_m = 0.0;
  double cell_m = 0.0;  // of the map: coarser than configured if it did not fit
  ByteBudget raster;
  RunQuality quality;
};

// Writes trajectory.tum, map.pgm, map.yaml, map.png and graph.g2o, and marks.csv if there are marks; each file whole or
// not at all.
[[nodiscard]] Expected<RunOutputsSummary> write_run_outputs(const RunOutputs& run);

// The map as the live graph has it, without a solve: sub-maps are rigid, and what is newer than the graph follows by
// the filter's own way. Up to and with sub-map `last`. Errors: those of the source.
[[nodiscard]] Expected<FinalResult> live_result(const GraphState& graph, std::uint32_t last, SubmapSource& submaps);

// Such a map as a picture.
[[nodiscard]] Status draw_live_map(const std::filesystem::path& path, const std::string& subtitle,
                                   const FinalResult& live, SubmapSource& submaps, const MapperOptions& mapper,
                                   std::size_t raster_bytes);

}  // namespace submapd
