#include "slam/output/run_outputs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/output/g2o_file.hpp"
#include "slam/output/map_builder.hpp"
#include "slam/output/map_files.hpp"
#include "slam/output/map_picture.hpp"
#include "slam/output/optimized_trajectory.hpp"
#include "slam/output/trajectory_file.hpp"

namespace submapd {
namespace {

// Poses of the marks, each between the two scans about it; marks outside of the run get none.
class MarkPoses {
 public:
  MarkPoses(const std::vector<Mark>& marks, const FinalResult& result) : marks_(marks), result_(result) {}

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
    std::string text = "name,utime_us,x_m,y_m,yaw_rad,sigma_m,sigma_rad\n";
    for (const auto& [mark, pose] : found_) {
      const Eigen::Matrix3d covariance = covariance_bound(result_, mark.utime_us, pose);
      text += fmt::format("{},{},{:.6f},{:.6f},{:.8f},{:.4f},{:.6f}\n", mark.name, mark.utime_us, pose.x, pose.y,
                          wrap_angle(pose.yaw), std::sqrt(std::max(covariance(0, 0), covariance(1, 1))),
                          std::sqrt(covariance(2, 2)));
    }
    return atomic_write_file(path, std::as_bytes(std::span(text)));
  }

 private:
  const std::vector<Mark>& marks_;
  const FinalResult& result_;
  std::size_t next_ = 0;
  std::optional<Pose2> last_;
  std::int64_t last_us_ = 0;
  std::vector<std::pair<Mark, Pose2>> found_;
};

// A run's way: its length, and as many of its places as a picture can show, however long the run is.
class Way {
 public:
  void add(const Pose2& pose) {
    const double step_m = count_ > 0 ? (pose.translation() - last_.translation()).norm() : 0.0;
    length_m_ += step_m;
    last_ = pose;
    // Through condensed sub-maps a live map does not know the way: the picture has no line from here to nowhere.
    if (step_m > kGap_m) places_.push_back({std::nan(""), std::nan(""), 0.0});
    if (count_++ % stride_ != 0) return;
    if (places_.size() >= kMostPlaces) {
      for (std::size_t i = 0; 2 * i < places_.size(); ++i) places_[i] = places_[2 * i];
      places_.resize(places_.size() / 2);
      stride_ *= 2;
    }
    places_.push_back(pose);
  }
  [[nodiscard]] double length_m() const { return length_m_; }
  [[nodiscard]] std::vector<Pose2> places() const {
    std::vector<Pose2> places = places_;
    if (count_ > 0) places.push_back(last_);
    return places;
  }

 private:
  static constexpr std::size_t kMostPlaces = 40'000;
  static constexpr double kGap_m = 5.0;
  std::vector<Pose2> places_;
  std::uint64_t stride_ = 1;
  std::uint64_t count_ = 0;
  Pose2 last_;
  double length_m_ = 0.0;
};

Status write_trajectory(const RunOutputs& run, const OptimizedTrajectory& trajectory, Way& way,
                        QualityCollector& quality) {
  TrajectoryFile file(run.folder / "trajectory.tum");
  MarkPoses marks(run.marks, run.result);
  Status status = trajectory.for_each([&](const SpooledPose& spooled, const Pose2& pose) {
    if (spooled.keyframe) way.add(pose);
    marks.note(spooled.stamp_us, pose);
    quality.note_pose(spooled, pose);
    return file.add(spooled.stamp_us, pose);
  });
  if (status.ok()) status = file.commit();
  return status.ok() && !run.marks.empty() ? marks.write(run.folder / "marks.csv") : status;
}

// Of a key-frame of `submap`: its own, or if it has none where the sub-map carries it.
Pose2 pose_of(const FinalResult& result, const SubmapPose& submap, const Keyframe& keyframe) {
  const auto found =
      std::lower_bound(result.keyframes.begin(), result.keyframes.end(), keyframe.scan_index,
                       [](const OptimizedKeyframe& k, std::uint64_t scan_index) { return k.scan_index < scan_index; });
  if (found != result.keyframes.end() && found->scan_index == keyframe.scan_index) return found->map_from_base;
  return compose(submap.map_from_submap, keyframe.pose);
}

// Lays the scan of every key-frame into the map, each once, sub-map by sub-map so that few are in memory. The area of
// condensed sub-maps is others' as well.
Status build_map(const FinalResult& result, SubmapSource& submaps, MapBuilder& builder, QualityCollector& quality) {
  for (const bool insert : {false, true}) {
    if (insert) builder.begin();
    std::optional<std::uint64_t> last;  // neighbours share key-frames
    for (const SubmapPose& s : result.submaps) {
      if (s.state == SubmapState::kCondensed) continue;
      const Expected<std::shared_ptr<const FinishedSubmap>> submap = submaps.load(s.index);
      if (!submap) return submap.error();
      if (!insert) quality.note_submap(**submap);
      for (const Keyframe& k : (*submap)->keyframes) {
        if (last && k.scan_index <= *last) continue;
        last = k.scan_index;
        const Pose2 pose = pose_of(result, s, k);
        insert ? builder.insert(k, pose) : builder.extend(k, pose);
      }
    }
  }
  return {};
}

Status write_picture(const std::filesystem::path& file, const std::string& name, const std::string& subtitle,
                     const FinalResult& result, const MapImage& map, const Way& way) {
  const std::vector<Pose2> path = way.places();
  PictureInput picture{map, path, {}, {}, "", subtitle};
  std::unordered_map<std::uint32_t, Pose2> origins;
  for (const SubmapPose& submap : result.submaps) {
    picture.submaps.push_back({submap.index, submap.map_from_submap});
    origins[submap.index] = submap.map_from_submap;
  }
  std::size_t confirmed = 0;
  for (const Loop& loop : result.loops) {
    if (loop.state == LoopState::kRejected) continue;
    confirmed += loop.state == LoopState::kConfirmed ? 1 : 0;
    picture.loops.push_back({origins[loop.match.a].translation(), origins[loop.match.b].translation(),
                             loop.state == LoopState::kConfirmed});
  }
  picture.title = picture_title(name, way.length_m(), result.submaps.size(), confirmed);
  return write_map_picture(file, picture);
}

}  // namespace

Expected<RunOutputsSummary> write_run_outputs(const RunOutputs& run) {
  RunOutputsSummary summary;
  Way way;
  QualityCollector quality;
  const Expected<OptimizedTrajectory> trajectory = OptimizedTrajectory::make(run.result, run.poses, run.scans);
  if (!trajectory) return failure(trajectory.error());
  if (Status status = write_trajectory(run, *trajectory, way, quality); !status.ok()) return failure(status);
  summary.path_m = way.length_m();
  if (Status status = write_g2o(run.folder / "graph.g2o", run.result.graph); !status.ok()) return failure(status);
  const IndexMapOptions& options = run.mapper.map;
  MapImage map;
  {
    MapBuilder builder(options.cell_m, run.raster_bytes, options.occupancy, run.mapper.max_beams);
    if (Status status = build_map(run.result, run.submaps, builder, quality); !status.ok()) return failure(status);
    summary.raster = {"map_raster", builder.bytes(), builder.bytes(), builder.bytes_limit()};
    map = builder.image();
  }
  summary.cell_m = map.cell_m;
  summary.quality = quality.result(map, run.result);
  if (Status status = write_map_files(run.folder, map); !status.ok()) return failure(status);
  if (Status status = write_picture(run.folder / "map.png", run.name, run.subtitle, run.result, map, way);
      !status.ok()) {
    return failure(status);
  }
  return summary;
}

Expected<FinalResult> live_result(const GraphState& graph, std::uint32_t last, SubmapSource& submaps) {
  FinalResult live;
  live.loops = graph.loops;
  Pose2 map_from_odom;  // by the newest sub-map of the graph
  for (std::uint32_t index = 0; index <= last; ++index) {
    if (index < graph.submaps.size() && graph.submaps[index].state == SubmapState::kCondensed) {
      live.submaps.push_back(graph.submaps[index]);
      continue;  // its way is not drawn; its scans need not be read
    }
    const Expected<std::shared_ptr<const FinishedSubmap>> loaded = submaps.load(index);
    if (!loaded) return failure(loaded.error());
    const FinishedSubmap& submap = **loaded;
    if (index < graph.submaps.size()) {
      map_from_odom = compose(graph.submaps[index].map_from_submap, inverse(submap.odom_from_submap));
    }
    const Pose2 map_from_submap = compose(map_from_odom, submap.odom_from_submap);
    live.submaps.push_back({index, map_from_submap});
    if (index < graph.submaps.size()) live.submaps.back().state = graph.submaps[index].state;
    for (const Keyframe& k : submap.keyframes) {
      if (!live.keyframes.empty() && k.scan_index <= live.keyframes.back().scan_index) continue;
      live.keyframes.push_back({k.scan_index, k.stamp_us, compose(map_from_submap, k.pose)});
    }
  }
  return live;
}

Status draw_live_map(const std::filesystem::path& path, const std::string& subtitle, const FinalResult& live,
                     SubmapSource& submaps, const MapperOptions& mapper, std::size_t raster_bytes) {
  MapImage map;
  {
    QualityCollector unused;
    MapBuilder builder(mapper.map.cell_m, raster_bytes, mapper.map.occupancy, mapper.max_beams);
    if (Status status = build_map(live, submaps, builder, unused); !status.ok()) return status;
    map = builder.image();
  }
  Way way;
  for (const OptimizedKeyframe& k : live.keyframes) way.add(k.map_from_base);
  return write_picture(path, "live map", subtitle, live, map, way);
}

}  // namespace submapd
