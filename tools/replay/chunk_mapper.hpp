// Maps one chunk of a log by itself: a mapper of its own, its sub-maps in a folder of their own.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "slam/base/worker_pool.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tools/replay/chunk_reader.hpp"
#include "tools/replay/scan_statistics.hpp"
#include "tools/replay/seam.hpp"

namespace submapd::tools {

struct MappedChunk {
  std::unique_ptr<SubmapArchive> submaps;  // indices from 0; odom frame of its own
  std::vector<std::uint64_t> scans_until;  // by sub-map: scans of the spool when it was finished
  std::unique_ptr<PoseSpool> poses;        // of the scans before the seam
  std::vector<SeamPose> seam;              // empty: the log's last chunk
  ScanStatistics scans;                    // before the seam, as all that follows
  MapperCounters counters;
  std::vector<ByteBudget> bytes;
};

struct ChunkFolders {
  std::filesystem::path submaps;  // made if missing
  std::filesystem::path poses;    // a file without a name is made in it
};

// Maps the chunk that `reader` has just entered, and its seam as long as the sub-maps that it began before last.
// `go_on` is asked before each scan. Errors: kIo, kUnavailable (not to go on).
[[nodiscard]] Expected<MappedChunk> map_chunk(ChunkReader& reader, const MapperOptions& options, const Uuid& cart,
                                              const Uuid& run, WorkerPool& pool, const ChunkFolders& folders,
                                              const std::function<bool()>& go_on);

}  // namespace submapd::tools
