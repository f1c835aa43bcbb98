#include "tools/replay/chunked_mapping.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>
#include <utility>

namespace submapd::tools {
namespace {

// A folder that is gone with the object.
class TemporaryFolder {
 public:
  explicit TemporaryFolder(std::filesystem::path path) : path_(std::move(path)) {}
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() { clear(); }

  Status make() {
    clear();
    std::error_code error;
    std::filesystem::create_directories(path_, error);
    if (!error) return {};
    return {StatusCode::kIo, fmt::format("cannot make the folder {}: {}", path_.string(), error.message())};
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  void clear() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  const std::filesystem::path path_;
};

class Joiner {
 public:
  explicit Joiner(const MappingOutputs& out) : out_(out) {}

  // `next`: the chunk that follows, nothing after the last.
  Status join(const MappedChunk& chunk, const MappedChunk* next);
  void finish() const;

 private:
  Status feed_submap(const MappedChunk& chunk, std::uint32_t local, const FinishedSubmap* next_first);
  Status pass_on(const SpooledPose& pose);

  const MappingOutputs& out_;
  std::uint32_t first_index_ = 0;  // of the present chunk's sub-maps
  Pose2 odom_from_chunk_;          // the run's odom frame and the present chunk's
  std::optional<SeamPose> seam_;   // of the present chunk's first scan, as the one before saw it
  std::size_t shared_ = 0;         // key-frames of the last sub-map with the next chunk
  std::uint64_t breaks_ = 0;
  FinishedSubmap newest_;                            // as it was fed, without cells
  std::unordered_map<std::uint64_t, Pose2> placed_;  // key-frames of the open sub-map, in the odom frame
  ScanStatistics scans_;
  MapperCounters counters_;
};

Status Joiner::pass_on(const SpooledPose& pose) {
  SpooledPose joined = pose;
  if (seam_) {  // the chunk's first scan
    joined.previous_keyframe_from_base = seam_->step;
    joined.linked = shared_ > 0 && seam_->linked;
    seam_.reset();
  }
  if (Status status = out_.poses.add(joined); !status.ok()) return status;
  const auto keyframe = placed_.find(pose.keyframe_scan_index);
  if (keyframe == placed_.end()) {
    return {StatusCode::kInternal, fmt::format("key-frame {} is in no sub-map", pose.keyframe_scan_index)};
  }
  const Pose2 odom_from_base = compose(keyframe->second, pose.keyframe_from_base);
  return out_.filter_trajectory.add(pose.stamp_us, compose(out_.feed.map_from_odom(), odom_from_base));
}

Status Joiner::feed_submap(const MappedChunk& chunk, std::uint32_t local, const FinishedSubmap* next_first) {
  const Expected<std::shared_ptr<const FinishedSubmap>> loaded = chunk.submaps->load(local);
  if (!loaded) return loaded.error();
  FinishedSubmap submap = **loaded;
  submap.id.index = first_index_ + local;
  submap.odom_from_submap = compose(odom_from_chunk_, submap.odom_from_submap);
  if (local == 0) submap.linked_to_previous = first_index_ == 0 ? submap.linked_to_previous : shared_ > 0;
  if (submap.id.index > 0 && !submap.linked_to_previous) ++breaks_;
  if (next_first != nullptr) shared_ = share_seam(submap, chunk.seam, *next_first);
  if (Status status = out_.feed.feed(submap); !status.ok()) return status;
  submap.blocks = {};
  submap.surface = {};
  newest_ = std::move(submap);
  return {};
}

Status Joiner::join(const MappedChunk& chunk, const MappedChunk* next) {
  std::shared_ptr<const FinishedSubmap> next_first;
  if (next != nullptr) {
    Expected<std::shared_ptr<const FinishedSubmap>> loaded = next->submaps->load(0);
    if (!loaded) return loaded.error();
    next_first = std::move(*loaded);
  }
  const auto submaps = static_cast<std::uint32_t>(chunk.scans_until.size());
  std::uint32_t local = 0;
  std::uint64_t scans = 0;
  const auto place = [&]() -> Status {
    const Expected<std::shared_ptr<const FinishedSubmap>> open = chunk.submaps->load(local);
    if (!open) return open.error();
    placed_.clear();
    const Pose2 odom_from_submap = compose(odom_from_chunk_, (*open)->odom_from_submap);
    for (const Keyframe& k : (*open)->keyframes) placed_[k.scan_index] = compose(odom_from_submap, k.pose);
    return {};
  };
  if (Status status = place(); !status.ok()) return status;
  const auto finish_until = [&](std::uint64_t until) -> Status {
    while (local < submaps && chunk.scans_until[local] <= until) {
      if (Status status = feed_submap(chunk, local, next_first.get()); !status.ok()) return status;
      if (++local == submaps) break;
      if (Status status = place(); !status.ok()) return status;
    }
    return {};
  };
  const Status status = chunk.poses->for_each(chunk.poses->size(), [&](const SpooledPose& pose) -> Status {
    if (Status finished = finish_until(scans); !finished.ok()) return finished;
    ++scans;
    return pass_on(pose);
  });
  if (!status.ok()) return status;
  if (Status finished = finish_until(scans); !finished.ok()) return finished;

  first_index_ += submaps;
  if (next != nullptr) {
    // Where the last sub-map saw the next chunk's first scan, which is the origin of that one's frame.
    const auto& keyframes = newest_.keyframes;
    const auto first = std::find_if(keyframes.begin(), keyframes.end(), [&](const Keyframe& k) {
      return k.scan_index == next_first->keyframes.front().scan_index;
    });
    const Keyframe& at = first != keyframes.end() ? *first : keyframes.back();
    odom_from_chunk_ = compose(compose(newest_.odom_from_submap, at.pose), inverse(next_first->odom_from_submap));
    seam_ = chunk.seam.front();
  }
  scans_.add(chunk.scans);
  counters_.scans += chunk.scans.scans;
  counters_.keyframes += chunk.counters.keyframes;
  counters_.lost_scans += chunk.counters.lost_scans;
  counters_.searches += chunk.counters.searches;
  counters_.forced_coalescences += chunk.counters.forced_coalescences;
  counters_.pool_refusals += chunk.counters.pool_refusals;
  counters_.keyframes_refused += chunk.counters.keyframes_refused;
  counters_.odometry_rejected = counters_.odometry_rejected || chunk.counters.odometry_rejected;
  counters_.degenerate_s += chunk.counters.degenerate_s;
  return {};
}

void Joiner::finish() const {
  scans_.write_to(out_.metrics);
  out_.metrics.mapper = counters_;
  out_.metrics.mapper.breaks = breaks_;
}

}  // namespace

Status map_in_chunks(ChunkTeamOptions options, const MappingOutputs& out) {
  TemporaryFolder folder(options.folder / "chunks");
  if (Status status = folder.make(); !status.ok()) return status;
  options.folder = folder.path();
  ChunkTeam team(std::move(options));
  ReplayProgress shown;
  const auto tell = [&](const ChunkTeamProgress& progress) {
    shown.scans = progress.scans;
    shown.share = progress.share;
    shown.submaps = out.feed.submaps();
    shown.loops = out.feed.confirmed_loops();
    out.progress(shown);
  };
  Joiner joiner(out);
  Expected<std::optional<MappedChunk>> chunk = team.take(tell);
  for (std::uint64_t number = 0; chunk && chunk->has_value(); ++number) {
    Expected<std::optional<MappedChunk>> next = team.take(tell);
    if (!next) return next.error();
    if (Status status = joiner.join(**chunk, next->has_value() ? &**next : nullptr); !status.ok()) return status;
    std::error_code error;  // what stays goes with the folder
    std::filesystem::remove_all(ChunkTeam::folder_of(folder.path(), number), error);
    chunk = std::move(next);
  }
  if (!chunk) return chunk.error();
  joiner.finish();
  out.metrics.log = team.log();
  out.metrics.bytes = team.bytes();
  return {};
}

}  // namespace submapd::tools
