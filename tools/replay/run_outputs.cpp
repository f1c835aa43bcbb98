#include "tools/replay/run_outputs.hpp"

#include <fmt/format.h>

#include <cmath>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "slam/output/g2o_file.hpp"
#include "slam/output/map_builder.hpp"
#include "slam/output/map_files.hpp"
#include "slam/output/map_picture.hpp"
#include "slam/output/trajectory_file.hpp"
#include "tools/version.hpp"

namespace submapd::tools {
namespace {

// Optimised key-frames by scan, and the correction that grows from each to the next.
class OptimizedPath {
 public:
  explicit OptimizedPath(const FinalResult& result) : keyframes_(result.keyframes), misfit_(result.keyframes.size()) {
    for (std::size_t i = 0; i < keyframes_.size(); ++i) position_[keyframes_[i].scan_index] = i;
  }

  // A key-frame as the filter saw it from its predecessor: the difference to the optimised one is spread over the scans
  // between the two.
  void note_step(const SpooledPose& pose) {
    const auto found = position_.find(pose.keyframe_scan_index);
    if (!pose.linked || found == position_.end() || found->second == 0) return;
    const std::size_t before = found->second - 1;
    const Pose2 expected = compose(keyframes_[before].map_from_base, pose.previous_keyframe_from_base);
    misfit_[before] = between(expected, keyframes_[found->second].map_from_base);
  }

  [[nodiscard]] std::optional<Pose2> pose_of(const SpooledPose& pose) const {
    const auto found = position_.find(pose.keyframe_scan_index);
    if (found == position_.end()) return std::nullopt;
    const std::size_t i = found->second;
    const Pose2 here = compose(keyframes_[i].map_from_base, pose.keyframe_from_base);
    if (i + 1 >= keyframes_.size()) return here;
    const auto span_us = static_cast<double>(keyframes_[i + 1].stamp_us - keyframes_[i].stamp_us);
    const auto since_us = static_cast<double>(pose.stamp_us - keyframes_[i].stamp_us);
    if (span_us <= 0.0) return here;
    const double share = std::clamp(since_us / span_us, 0.0, 1.0);
    return compose(here, exp_twist(log_pose(misfit_[i], 1.0), share));
  }

 private:
  const std::vector<OptimizedKeyframe>& keyframes_;
  std::vector<Pose2> misfit_;  // from key-frame i to i + 1
  std::unordered_map<std::uint64_t, std::size_t> position_;
};

Status write_trajectory(RunOutputs& run, std::vector<Pose2>& picture_path) {
  OptimizedPath path(run.result);
  if (Status status = run.spool.for_each([&](const SpooledPose& pose) {
        if (pose.keyframe) path.note_step(pose);
        return Status();
      });
      !status.ok()) {
    return status;
  }
  TrajectoryFile file(run.folder / "trajectory.tum");
  std::optional<Pose2> last;
  Status status = run.spool.for_each([&](const SpooledPose& pose) {
    const std::optional<Pose2> optimised = path.pose_of(pose);
    if (!optimised)
      return Status(StatusCode::kInternal, fmt::format("key-frame {} has no optimised pose", pose.keyframe_scan_index));
    if (pose.keyframe) {
      if (last) run.metrics.path_m += std::hypot(optimised->x - last->x, optimised->y - last->y);
      last = optimised;
      picture_path.push_back(*optimised);
    }
    return file.add(pose.stamp_us, *optimised);
  });
  return status.ok() ? file.commit() : status;
}

// Lays every track point's scan into the map, each once, sub-map by sub-map so that few are in memory.
Status build_map(RunOutputs& run, MapBuilder& builder) {
  std::unordered_map<std::uint64_t, Pose2> poses;
  for (const OptimizedKeyframe& k : run.result.keyframes) poses[k.scan_index] = k.map_from_base;
  for (const bool insert : {false, true}) {
    if (insert) builder.begin();
    std::unordered_set<std::uint64_t> done;
    for (const SubmapPose& s : run.result.submaps) {
      const Expected<std::shared_ptr<const FinishedSubmap>> submap = run.submaps.load(s.index);
      if (!submap) return submap.error();
      for (const Keyframe& k : (*submap)->keyframes) {
        const auto pose = poses.find(k.scan_index);
        if (pose == poses.end() || !done.insert(k.scan_index).second) continue;
        insert ? builder.insert(k, pose->second) : builder.extend(k, pose->second);
      }
    }
  }
  return {};
}

Status write_picture(const RunOutputs& run, const MapImage& map, const std::vector<Pose2>& path) {
  PictureInput picture{map, path, {}, {}, "", fmt::format("submapd {}, seed {}", kVersion, run.metrics.seed)};
  std::unordered_map<std::uint32_t, Pose2> origins;
  for (const SubmapPose& s : run.result.submaps) {
    picture.submaps.push_back({s.index, s.map_from_submap});
    origins[s.index] = s.map_from_submap;
  }
  std::size_t confirmed = 0;
  for (const Loop& loop : run.result.loops) {
    if (loop.state == LoopState::kRejected) continue;
    confirmed += loop.state == LoopState::kConfirmed ? 1 : 0;
    picture.loops.push_back({origins[loop.match.a].translation(), origins[loop.match.b].translation(),
                             loop.state == LoopState::kConfirmed});
  }
  picture.title = picture_title(run.name, run.metrics.path_m, run.result.submaps.size(), confirmed);
  return write_map_picture(run.folder / "map.png", picture);
}

}  // namespace

Status write_run_outputs(RunOutputs& run) {
  std::vector<Pose2> path;
  if (Status status = write_trajectory(run, path); !status.ok()) return status;
  if (Status status = write_g2o(run.folder / "graph.g2o", run.result.graph); !status.ok()) return status;
  const MapperOptions& mapper = run.configuration.mapper;
  MapImage map;
  {
    MapBuilder builder(mapper.map.cell_m, run.configuration.map_raster_bytes, mapper.map.occupancy, mapper.max_beams);
    if (Status status = build_map(run, builder); !status.ok()) return status;
    run.metrics.bytes.push_back({"map_raster", builder.bytes(), builder.bytes(), builder.bytes_limit()});
    map = builder.image();
  }
  if (Status status = write_map_files(run.folder, map); !status.ok()) return status;
  return write_picture(run, map, path);
}

}  // namespace submapd::tools
