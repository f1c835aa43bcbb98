// Drives through the simulated office for the mapper's tests, and what is expected of any of its runs.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <vector>

#include "daemon/thread_pool.hpp"
#include "slam/filter/mapper.hpp"
#include "slam/submap/submap_codec.hpp"
#include "tools/sim/office.hpp"
#include "tools/sim/simulator.hpp"

namespace submapd::test {

inline constexpr double kDriveLimit_m = 0.007;

struct Drive {
  std::vector<Scan> scans;
  std::vector<Pose2> truth;  // one a scan
};

struct DriveOptions {
  double duration_s = 20.0;
  double speed_m_s = 3.0;
  double standstill_s = 1.0;
  std::uint64_t seed = 1;
  int beams = 1081;
  bool odometry = false;
};

inline Drive drive_through(const tools::World& world, const tools::Route& route, const DriveOptions& wanted) {
  tools::MotionOptions motion_options;
  motion_options.seed = wanted.seed;
  motion_options.duration_s = wanted.duration_s;
  motion_options.speed_m_s = wanted.speed_m_s;
  motion_options.standstill_s = wanted.standstill_s;
  Expected<tools::Motion> motion = tools::Motion::along(route, motion_options);
  EXPECT_TRUE(motion.has_value());
  tools::SimulatorOptions options;
  options.seed = wanted.seed;
  options.sensor.beams = wanted.beams;
  options.sensor.geometry.angle_step_rad *= 1080.0 / (wanted.beams - 1);
  if (wanted.odometry) {
    options.odometry = tools::OdometryOptions{};
  }
  tools::Simulator simulator(std::make_shared<const tools::World>(world),
                             std::make_shared<const tools::Motion>(std::move(*motion)), options);
  Drive drive;
  while (std::optional<Scan> scan = simulator.next()) {
    drive.truth.push_back(simulator.truth(*scan));
    drive.scans.push_back(std::move(*scan));
  }
  return drive;
}

inline Drive drive_in_office(const DriveOptions& wanted) {
  return drive_through(tools::office_world(), tools::office_tour(), wanted);
}

// Straight ahead and through turns of 90 and 180 deg at up to 3 m/s.
inline const Drive& fast_drive() {
  static const Drive kDrive = drive_in_office({});
  return kDrive;
}

// Seven seconds at walking pace with half of the beams, for the filters that carry many maps.
inline const Drive& slow_drive() {
  static const Drive kDrive = drive_in_office({7.0, 1.0, 0.5, 2, 541});
  return kDrive;
}

struct MapperRun {
  std::vector<ScanReport> reports;
  std::vector<FinishedSubmap> submaps;
  MapperCounters counters;
  std::vector<ByteBudget> budgets;
};

inline MapperRun run_mapper(const std::vector<Scan>& scans, const MapperOptions& options = {}, int threads = 1) {
  ThreadPool pool(threads);
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  MapperRun run;
  const auto take = [&] {
    if (std::optional<FinishedSubmap> finished = mapper.take_finished()) run.submaps.push_back(std::move(*finished));
  };
  for (const Scan& scan : scans) {
    run.reports.push_back(mapper.process(scan));
    for (const ByteBudget& b : mapper.budgets()) {
      EXPECT_LE(b.used, b.limit) << b.name << " at scan " << scan.index;
      EXPECT_LE(b.peak, b.limit) << b.name << " at scan " << scan.index;
    }
    take();
  }
  mapper.finish_run();
  take();
  run.counters = mapper.counters();
  run.budgets = mapper.budgets();
  return run;
}

// The same drive, but after `cut` scans everything is gone except the finished sub-maps, and `lost` scans more are
// missing.
inline MapperRun run_mapper_cut_off(const std::vector<Scan>& scans, std::size_t cut, std::size_t lost,
                                    const MapperOptions& options) {
  const std::vector<Scan> before(scans.begin(), scans.begin() + static_cast<std::ptrdiff_t>(cut));
  MapperRun run = run_mapper(before, options);
  run.submaps.pop_back();  // finish_run()'s
  EXPECT_FALSE(run.submaps.empty());
  if (run.submaps.empty()) return run;
  const std::uint64_t last = run.submaps.back().keyframes.back().scan_index;
  std::erase_if(run.reports, [last](const ScanReport& report) { return report.scan_index > last; });
  ThreadPool pool(1);
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  mapper.resume_after(run.submaps.back());
  EXPECT_FALSE(mapper.has_finished());
  for (const Scan& scan : scans) {
    if (scan.index <= last) continue;
    if (scan.index == cut) mapper.expect_gap();
    if (scan.index >= cut && scan.index < cut + lost) continue;
    run.reports.push_back(mapper.process(scan));
    if (std::optional<FinishedSubmap> finished = mapper.take_finished()) run.submaps.push_back(std::move(*finished));
  }
  mapper.finish_run();
  if (std::optional<FinishedSubmap> finished = mapper.take_finished()) run.submaps.push_back(std::move(*finished));
  run.counters = mapper.counters();
  return run;
}

struct TrajectoryError {
  double rms_m = 0.0;
  double max_m = 0.0;
  double max_heading_rad = 0.0;
};

// Error of the odom poses after the best SE(2) alignment (least squares over positions).
inline TrajectoryError error_of(std::span<const ScanReport> reports, std::span<const Pose2> truth) {
  EXPECT_EQ(reports.size(), truth.size());
  Eigen::Vector2d mean_estimate = Eigen::Vector2d::Zero();
  Eigen::Vector2d mean_truth = Eigen::Vector2d::Zero();
  const auto n = static_cast<double>(reports.size());
  for (std::size_t i = 0; i < reports.size(); ++i) {
    mean_estimate += reports[i].odom_from_base.translation() / n;
    mean_truth += truth[i].translation() / n;
  }
  double along = 0.0;
  double across = 0.0;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    const Eigen::Vector2d e = reports[i].odom_from_base.translation() - mean_estimate;
    const Eigen::Vector2d t = truth[i].translation() - mean_truth;
    along += e.dot(t);
    across += e.x() * t.y() - e.y() * t.x();
  }
  Pose2 world_from_odom{0.0, 0.0, std::atan2(across, along)};
  const Eigen::Vector2d shift = mean_truth - rotation(world_from_odom.yaw) * mean_estimate;
  world_from_odom.x = shift.x();
  world_from_odom.y = shift.y();
  TrajectoryError error;
  double square_sum = 0.0;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    const Pose2 off = between(truth[i], compose(world_from_odom, reports[i].odom_from_base));
    const double d = std::hypot(off.x, off.y);
    square_sum += d * d;
    error.max_m = std::max(error.max_m, d);
    error.max_heading_rad = std::max(error.max_heading_rad, std::abs(off.yaw));
  }
  error.rms_m = std::sqrt(square_sum / n);
  return error;
}

inline void expect_finite(const std::vector<ScanReport>& reports) {
  for (const ScanReport& r : reports) {
    const double all[] = {r.submap_from_base.x,
                          r.submap_from_base.y,
                          r.submap_from_base.yaw,
                          r.odom_from_base.x,
                          r.odom_from_base.y,
                          r.odom_from_base.yaw,
                          r.keyframe_from_base.x,
                          r.keyframe_from_base.y,
                          r.keyframe_from_base.yaw,
                          r.keyframe_step.x,
                          r.keyframe_step.yaw,
                          r.covariance.sum(),
                          r.entropy,
                          r.n_eff};
    for (const double value : all) ASSERT_TRUE(std::isfinite(value)) << "scan " << r.scan_index;
  }
}

// What every run's sub-maps must be, whatever happened on the way.
inline void expect_sound_submaps(const MapperRun& run) {
  ASSERT_FALSE(run.submaps.empty());
  std::set<std::uint64_t> inserted;
  for (std::size_t k = 0; k < run.submaps.size(); ++k) {
    SCOPED_TRACE("sub-map " + std::to_string(k));
    const FinishedSubmap& s = run.submaps[k];
    EXPECT_EQ(s.id.index, k) << "indices are consecutive";
    ASSERT_FALSE(s.keyframes.empty());
    EXPECT_EQ(s.keyframes[0].pose, Pose2{});
    for (std::size_t i = 0; i < s.keyframes.size(); ++i) {
      if (i > 0) {
        EXPECT_GT(s.keyframes[i].scan_index, s.keyframes[i - 1].scan_index);
      }
      inserted.insert(s.keyframes[i].scan_index);
    }
    if (k == 0 || !s.linked_to_previous) continue;
    // Linked: from its first key-frame on, the one before holds the same key-frames, at the same places.
    const FinishedSubmap& before = run.submaps[k - 1];
    const auto shared = std::find_if(before.keyframes.begin(), before.keyframes.end(),
                                     [&s](const Keyframe& f) { return f.scan_index == s.keyframes[0].scan_index; });
    ASSERT_NE(shared, before.keyframes.end()) << "shares nothing with the one before";
    const Pose2 step = between(before.odom_from_submap, s.odom_from_submap);
    for (auto f = shared; f != before.keyframes.end(); ++f) {
      const auto i = static_cast<std::size_t>(f - shared);
      ASSERT_LT(i, s.keyframes.size());
      ASSERT_EQ(f->scan_index, s.keyframes[i].scan_index);
      const Pose2 off = between(f->pose, compose(step, s.keyframes[i].pose));
      EXPECT_LT(std::hypot(off.x, off.y) + std::abs(off.yaw), 1e-9 * (1.0 + s.odom_from_submap.translation().norm()));
    }
  }
  std::set<std::uint64_t> reported;
  for (const ScanReport& r : run.reports) {
    if (r.keyframe) reported.insert(r.scan_index);
    EXPECT_EQ(inserted.count(r.keyframe_scan_index), 1U)
        << "scan " << r.scan_index << " hangs on a key-frame of no sub-map";
  }
  EXPECT_EQ(reported, inserted) << "each key-frame is in some sub-map";
}

inline std::vector<Pose2> truth_of(const Drive& drive, const std::vector<ScanReport>& reports) {
  std::vector<Pose2> truth;
  for (const ScanReport& report : reports) truth.push_back(drive.truth[report.scan_index]);
  return truth;
}

inline MapperOptions short_submaps() {
  MapperOptions options;
  options.limits.path_m = 3.0;
  return options;
}

}  // namespace submapd::test
