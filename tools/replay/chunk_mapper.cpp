#include "tools/replay/chunk_mapper.hpp"

#include <optional>
#include <utility>

namespace submapd::tools {
namespace {

// Saves the sub-map that was just finished, if there is one; it was the open one for `scans` of the spool.
Expected<bool> keep(MappedChunk& chunk, const std::optional<FinishedSubmap>& finished, std::uint64_t scans) {
  if (!finished) return false;
  if (const Expected<Sha256> hash = chunk.submaps->save(*finished); !hash) return failure(hash.error());
  chunk.scans_until.push_back(scans);
  return true;
}

}  // namespace

Expected<MappedChunk> map_chunk(ChunkReader& reader, const MapperOptions& options, const Uuid& cart, const Uuid& run,
                                WorkerPool& pool, const ChunkFolders& folders, const std::function<bool()>& go_on) {
  MappedChunk chunk;
  Expected<std::unique_ptr<SubmapArchive>> archive = SubmapArchive::open(folders.submaps, 0);
  if (!archive) return failure(archive.error());
  chunk.submaps = std::move(*archive);
  Expected<std::unique_ptr<PoseSpool>> poses = PoseSpool::create(folders.poses);
  if (!poses) return failure(poses.error());
  chunk.poses = std::move(*poses);

  Mapper mapper(options, cart, run, pool);
  for (;;) {
    if (!go_on()) return failure(StatusCode::kUnavailable, "stopped");
    const Expected<std::optional<Scan>> scan = reader.next();
    if (!scan) return failure(scan.error());
    if (!scan->has_value()) break;
    const ScanReport report = chunk.scans.process(mapper, **scan);
    if (Status status = chunk.poses->add(spooled(report)); !status.ok()) return failure(status);
    const std::optional<FinishedSubmap> finished = mapper.take_finished();
    // After a break the scan is the first of the next one.
    const std::uint64_t of_next = finished && report.submap != finished->id.index ? 1 : 0;
    const Expected<bool> kept = keep(chunk, finished, chunk.poses->size() - of_next);
    if (!kept) return failure(kept.error());
  }
  chunk.counters = mapper.counters();
  bool ended = false;
  for (std::size_t k = 0; k < reader.seam_scans() && !ended && go_on(); ++k) {
    const Scan& scan = reader.ahead()[k];
    chunk.seam.push_back(seam_pose(mapper.process(scan)));
    const Expected<bool> kept = keep(chunk, mapper.take_finished(), chunk.poses->size());
    if (!kept) return failure(kept.error());
    if (!*kept) continue;
    // The next chunk's sub-maps begin with the seam; one of this chunk that began in it has nothing to tell.
    const std::optional<FinishedSubmap> open = mapper.snapshot_open();
    ended = !open || open->keyframes.front().scan_index >= chunk.seam.front().scan_index;
  }
  if (!ended) {
    mapper.finish_run();
    if (const Expected<bool> kept = keep(chunk, mapper.take_finished(), chunk.poses->size()); !kept)
      return failure(kept.error());
  }
  chunk.bytes = mapper.budgets();
  return chunk;
}

}  // namespace submapd::tools
