#include "slam/output/run_outputs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/output/g2o_file.hpp"
#include "slam/output/map_builder.hpp"
#include "slam/output/map_files.hpp"
#include "slam/output/map_picture.hpp"
#include "slam/output/trajectory_file.hpp"

namespace submapd {
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

// Poses of the marks, each between the two scans about it; marks outside of the run get none.
class MarkPoses {
 public:
  explicit MarkPoses(const std::vector<Mark>& marks) : marks_(marks) {}

  void note(std::int64_t stamp_us, const Pose2& pose) {
    for (; next_ < marks_.size() && marks_[next_].utime_us <= stamp_us; ++next_) {
      if (!last_) continue;
      const auto span_us = static_cast<double>(stamp_us - last_us_);
      const double share = span_us > 0.0 ? static_cast<double>(marks_[next_].utime_us - last_us_) / span_us : 1.0;
      found_.emplace_back(marks_[next_], interpolate(*last_, pose, share));
    }
    last_ = pose;
    last_us_ = stamp_us;
  }

  [[nodiscard]] Status write(const std::filesystem::path& path) const {
    std::string text = "name,utime_us,x_m,y_m,yaw_rad\n";
    for (const auto& [mark, pose] : found_) {
      text +=
          fmt::format("{},{},{:.6f},{:.6f},{:.8f}\n", mark.name, mark.utime_us, pose.x, pose.y, wrap_angle(pose.yaw));
    }
    return atomic_write_file(path, std::as_bytes(std::span(text)));
  }

 private:
  const std::vector<Mark>& marks_;
  std::size_t next_ = 0;
  std::optional<Pose2> last_;
  std::int64_t last_us_ = 0;
  std::vector<std::pair<Mark, Pose2>> found_;
};

// Fills `keyframes` with the way for the picture.
Status write_trajectory(const RunOutputs& run, std::vector<Pose2>& keyframes) {
  OptimizedPath path(run.result);
  if (Status status = run.poses.for_each(run.scans,
                                         [&](const SpooledPose& pose) {
                                           if (pose.keyframe) path.note_step(pose);
                                           return Status();
                                         });
      !status.ok()) {
    return status;
  }
  TrajectoryFile file(run.folder / "trajectory.tum");
  MarkPoses marks(run.marks);
  Status status = run.poses.for_each(run.scans, [&](const SpooledPose& pose) {
    const std::optional<Pose2> optimised = path.pose_of(pose);
    if (!optimised)
      return Status(StatusCode::kInternal, fmt::format("key-frame {} has no optimised pose", pose.keyframe_scan_index));
    if (pose.keyframe) keyframes.push_back(*optimised);
    marks.note(pose.stamp_us, *optimised);
    return file.add(pose.stamp_us, *optimised);
  });
  if (status.ok()) status = file.commit();
  return status.ok() && !run.marks.empty() ? marks.write(run.folder / "marks.csv") : status;
}

double length_m(const std::vector<Pose2>& path) {
  double sum_m = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    sum_m += std::hypot(path[i].x - path[i - 1].x, path[i].y - path[i - 1].y);
  }
  return sum_m;
}

// Lays every track point's scan into the map, each once, sub-map by sub-map so that few are in memory.
Status build_map(const RunOutputs& run, MapBuilder& builder) {
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

Status write_picture(const RunOutputs& run, const MapImage& map, const std::vector<Pose2>& path, double path_m) {
  PictureInput picture{map, path, {}, {}, "", run.subtitle};
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
  picture.title = picture_title(run.name, path_m, run.result.submaps.size(), confirmed);
  return write_map_picture(run.folder / "map.png", picture);
}

}  // namespace

Expected<RunOutputsSummary> write_run_outputs(const RunOutputs& run) {
  RunOutputsSummary summary;
  std::vector<Pose2> path;
  if (Status status = write_trajectory(run, path); !status.ok()) return failure(status);
  summary.path_m = length_m(path);
  if (Status status = write_g2o(run.folder / "graph.g2o", run.result.graph); !status.ok()) return failure(status);
  const IndexMapOptions& options = run.mapper.map;
  MapImage map;
  {
    MapBuilder builder(options.cell_m, run.raster_bytes, options.occupancy, run.mapper.max_beams);
    if (Status status = build_map(run, builder); !status.ok()) return failure(status);
    summary.raster = {"map_raster", builder.bytes(), builder.bytes(), builder.bytes_limit()};
    map = builder.image();
  }
  summary.cell_m = map.cell_m;
  if (Status status = write_map_files(run.folder, map); !status.ok()) return failure(status);
  if (Status status = write_picture(run, map, path, summary.path_m); !status.ok()) return failure(status);
  return summary;
}

}  // namespace submapd
