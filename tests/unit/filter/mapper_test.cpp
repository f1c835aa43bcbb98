// The front end on drives with exact truth, in simulated time: how far it is off, what it hands over, what it survives.
#include "slam/filter/mapper.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <thread>
#include <vector>

#include "slam/base/random.hpp"
#include "tests/unit/filter/mapper_rig.hpp"

namespace submapd {
namespace {

using namespace test;  // the rig

TEST(MapperScenarioTest, FastDriveThroughTheOffice) {
  const Drive& drive = fast_drive();
  const MapperRun run = run_mapper(drive.scans);
  const TrajectoryError error = error_of(run.reports, drive.truth);
  RecordProperty("rms_mm", std::to_string(1e3 * error.rms_m));
  std::printf("rms %.1f mm, max %.1f mm, heading %.3f deg\n", 1e3 * error.rms_m, 1e3 * error.max_m,
              error.max_heading_rad * 180.0 / std::numbers::pi);
  EXPECT_LT(error.rms_m, kDriveLimit_m);  // 3.4 mm
  EXPECT_LT(error.max_m, 0.022);          // 10.7 mm
  EXPECT_EQ(run.counters.lost_scans, 0U);
  EXPECT_EQ(run.counters.breaks, 0U);
  EXPECT_EQ(run.counters.pool_refusals, 0U);
  EXPECT_EQ(run.counters.scans, drive.scans.size());
  expect_finite(run.reports);
  expect_sound_submaps(run);

  MapperOptions smeared;
  smeared.unwarp = false;
  const TrajectoryError without = error_of(run_mapper(drive.scans, smeared).reports, drive.truth);
  std::printf("without unwarping: rms %.1f mm, max %.1f mm\n", 1e3 * without.rms_m, 1e3 * without.max_m);
  EXPECT_GT(without.rms_m, 3.0 * error.rms_m);
  EXPECT_GT(without.rms_m, kDriveLimit_m) << "the limit above would not notice";
}

TEST(MapperScenarioTest, SubmapsOverlapByHalf) {
  MapperOptions options;
  options.limits.path_m = 3.0;
  const Drive& drive = fast_drive();
  const MapperRun run = run_mapper(drive.scans, options);
  expect_sound_submaps(run);
  ASSERT_GE(run.submaps.size(), 5U);
  for (std::size_t k = 0; k < run.submaps.size(); ++k) {
    SCOPED_TRACE("sub-map " + std::to_string(k));
    const FinishedSubmap& s = run.submaps[k];
    EXPECT_TRUE(s.linked_to_previous);
    if (k + 1 == run.submaps.size()) {
      EXPECT_EQ(s.reason, FinishReason::kEndOfRun);
      continue;
    }
    EXPECT_EQ(s.reason, FinishReason::kPath);
    double path_m = 0.0;
    double until_next_m = 0.0;
    for (std::size_t i = 1; i < s.keyframes.size(); ++i) {
      const Pose2 step = between(s.keyframes[i - 1].pose, s.keyframes[i].pose);
      path_m += std::hypot(step.x, step.y);
      if (s.keyframes[i].scan_index == run.submaps[k + 1].keyframes[0].scan_index) until_next_m = path_m;
    }
    EXPECT_GE(path_m, 3.0);
    EXPECT_LE(path_m, 3.5);
    EXPECT_NEAR(until_next_m / path_m, 0.5, 0.1);
  }
}

TEST(MapperScenarioTest, ARunMayBeOneMapAsFarAsItsKeyframesReach) {
  MapperOptions options = short_submaps();
  options.limits.never_full = true;
  options.limits.keyframes = 400;
  const Drive& drive = fast_drive();
  const MapperRun run = run_mapper(drive.scans, options);
  expect_sound_submaps(run);
  ASSERT_EQ(run.submaps.size(), 1U);
  EXPECT_EQ(run.submaps[0].reason, FinishReason::kEndOfRun);
  EXPECT_EQ(run.submaps[0].keyframes.size(), run.counters.keyframes);
  EXPECT_EQ(run.counters.keyframes_refused, 0U);
  EXPECT_LT(error_of(run.reports, drive.truth).rms_m, kDriveLimit_m);
  options.limits.keyframes = 40;
  EXPECT_GT(run_mapper(drive.scans, options).counters.keyframes_refused, 0U);
}

TEST(MapperScenarioTest, StandstillNeitherCreepsNorGrows) {
  tools::MotionOptions motion_options;
  motion_options.speed_m_s = 1.0;
  tools::Route stand;
  stand.waypoints = {{6.0, 7.0}, {6.5, 7.0}};
  motion_options.standstill_s = 61.0;
  Expected<tools::Motion> motion = tools::Motion::along(stand, motion_options);
  ASSERT_TRUE(motion.has_value());
  tools::Simulator simulator(std::make_shared<const tools::World>(tools::office_world()),
                             std::make_shared<const tools::Motion>(std::move(*motion)), {});
  std::vector<Scan> scans;
  while (scans.size() < 2400) scans.push_back(simulator.next().value());
  EXPECT_EQ(simulator.truth(scans.back()), simulator.truth(scans.front())) << "the cart stands for 60 s";

  SerialPool pool;
  Mapper mapper(MapperOptions{}, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  // Every scan is off by its noise; creep is what the mean of a second does in a minute.
  std::vector<Eigen::Vector2d> means(60, Eigen::Vector2d::Zero());
  double farthest_m = 0.0;
  std::size_t used_early = 0;
  std::size_t used_late = 0;
  for (const Scan& scan : scans) {
    const ScanReport report = mapper.process(scan);
    EXPECT_EQ(report.keyframe, scan.index == 0) << "scan " << scan.index;
    EXPECT_EQ(report.particles, 1);
    means[scan.index / 40] += report.odom_from_base.translation() / 40.0;
    farthest_m = std::max(farthest_m, std::hypot(report.odom_from_base.x, report.odom_from_base.y));
    used_late = 0;
    for (const ByteBudget& b : mapper.budgets()) used_late += b.used;
    if (scan.index == 1) used_early = used_late;
  }
  double creep_m = 0.0;
  for (const Eigen::Vector2d& mean : means) creep_m = std::max(creep_m, (mean - means[0]).norm());
  std::printf("creep %.2f mm, farthest scan %.2f mm\n", 1e3 * creep_m, 1e3 * farthest_m);
  EXPECT_LT(creep_m, 0.002);
  EXPECT_LT(farthest_m, 0.005);  // 2.5 mm
  EXPECT_EQ(used_late, used_early);
  EXPECT_EQ(mapper.counters().keyframes, 1U);
  EXPECT_EQ(mapper.counters().lost_scans, 0U);
}

// ---- faults ----

TEST(MapperFaultTest, ABlindSensorAddsNothingToTheMap) {
  Drive drive = fast_drive();
  const std::size_t from = 6 * 40;
  const std::size_t to = from + 3 * 40;
  for (std::size_t i = from; i < to; ++i)
    std::fill(drive.scans[i].ranges_mm.begin(), drive.scans[i].ranges_mm.end(), kNoReturn_mm);
  const MapperRun run = run_mapper(drive.scans);
  expect_finite(run.reports);
  expect_sound_submaps(run);
  for (std::size_t i = from; i < to; ++i) {
    EXPECT_TRUE(run.reports[i].lost) << "scan " << i << " saw nothing";
    EXPECT_FALSE(run.reports[i].keyframe) << "scan " << i << " saw nothing";
  }
  // Three seconds of driving blind: either the place is found again, or the map goes on apart, and says so.
  bool tied = true;
  for (const FinishedSubmap& s : run.submaps) tied = tied && s.linked_to_previous;
  EXPECT_EQ(run.counters.breaks == 0, tied);
  const std::span<const ScanReport> after(run.reports.begin() + static_cast<std::ptrdiff_t>(to) + 40,
                                          run.reports.end());
  const std::span<const Pose2> after_truth(drive.truth.begin() + static_cast<std::ptrdiff_t>(to) + 40,
                                           drive.truth.end());
  EXPECT_LT(error_of(after, after_truth).rms_m, 0.05) << "a second later it maps as ever";
  if (tied) {
    const Pose2 off = between(between(run.reports[from - 1].odom_from_base, after[0].odom_from_base),
                              between(drive.truth[from - 1], after_truth[0]));
    EXPECT_LT(off.translation().norm(), 0.05) << "it says that it found its place again";
  }
  EXPECT_LE(run.counters.breaks, 2U);
}

TEST(MapperFaultTest, FewBeamsAndChangingGeometryAndStampsDoNotHarm) {
  std::vector<Scan> scans(fast_drive().scans.begin(), fast_drive().scans.begin() + 100);
  for (std::size_t i = 40; i < scans.size(); ++i) {
    Scan& s = scans[i];
    if (i % 10 == 0) s.ranges_mm.clear();
    if (i % 10 == 1) s.ranges_mm.resize(1);
    if (i % 10 == 2) s.ranges_mm.resize(2);
    if (i % 10 == 3) s.ranges_mm.resize(5000, 4000);
    if (i % 10 == 4) s.geometry.angle_step_rad *= 2.0;
    if (i % 10 == 5) s.geometry.base_from_sensor = {0.3, -0.1, 1.0};
    if (i % 20 == 6) s.stamp_us = scans[i - 1].stamp_us;
    if (i == 56) s.stamp_us = scans[i - 1].stamp_us - 3'000'000;
  }
  const MapperRun run = run_mapper(scans);
  expect_finite(run.reports);
  expect_sound_submaps(run);
}

TEST(MapperFaultTest, GarbageScansLeaveFinitePoses) {
  for (const FilterMode mode : {FilterMode::kAdaptive, FilterMode::kRbpf, FilterMode::kFastSlam}) {
    CounterRandom random(5, static_cast<std::uint64_t>(mode), 0);
    std::vector<Scan> scans;
    std::int64_t stamp_us = 0;
    for (std::uint64_t i = 0; i < 12; ++i) {
      Scan scan;
      scan.index = i;
      stamp_us += static_cast<std::int64_t>(random.uniform(-2e5, 4e5));
      if (random.uniform() < 0.02) stamp_us += 100'000'000'000;
      scan.stamp_us = stamp_us;
      scan.geometry.first_angle_rad = random.uniform(-7.0, 7.0);
      scan.geometry.angle_step_rad = random.uniform(-0.1, 0.1);
      scan.geometry.sweep_s = random.uniform(-0.1, 0.2);
      scan.geometry.range_max_m = random.uniform(0.0, 80.0);
      scan.geometry.base_from_sensor = {random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0),
                                        random.uniform(-9.0, 9.0)};
      scan.ranges_mm.resize(static_cast<std::size_t>(random.uniform() < 0.1 ? 3000.0 : random.uniform(0.0, 300.0)));
      for (std::uint16_t& r : scan.ranges_mm) r = static_cast<std::uint16_t>(random.next_u64());
      if (random.uniform() < 0.5)
        scan.odometry = Pose2{random.uniform(-1e3, 1e3), random.uniform(-1e3, 1e3), random.uniform(-1e3, 1e3)};
      scans.push_back(std::move(scan));
    }
    MapperOptions options;
    options.filter = mode;
    options.particles = 3;
    const MapperRun run = run_mapper(scans, options, 2);
    SCOPED_TRACE(static_cast<int>(mode));
    expect_finite(run.reports);
    expect_sound_submaps(run);
  }
}

TEST(MapperFaultTest, ANewSubmapWaitsUntilTheOldOneIsTaken) {
  MapperOptions options;
  options.limits.path_m = 4.0;
  SerialPool pool;
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  const Drive& drive = fast_drive();
  std::vector<ScanReport> reports;
  for (const Scan& scan : drive.scans) {
    reports.push_back(mapper.process(scan));
    if (scan.index == 600) break;
  }
  ASSERT_TRUE(mapper.has_finished());
  EXPECT_EQ(mapper.take_finished()->id.index, 0U);
  EXPECT_FALSE(mapper.has_finished()) << "nothing was closed meanwhile";
  mapper.process(drive.scans[601]);
  ASSERT_TRUE(mapper.has_finished());
  EXPECT_EQ(mapper.take_finished()->id.index, 1U);
  EXPECT_LT(error_of(reports, std::span(drive.truth).first(601)).rms_m, 0.05);
}

// ---- what others take while the run goes on ----

TEST(MapperSnapshotTest, IsTheLastSubmapAsItWouldBeClosedNow) {
  SerialPool pool;
  Mapper mapper({}, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  EXPECT_FALSE(mapper.snapshot_open().has_value());
  for (const Scan& scan : std::span(fast_drive().scans).first(250)) mapper.process(scan);
  const std::optional<FinishedSubmap> open = mapper.snapshot_open();
  ASSERT_TRUE(open.has_value());
  EXPECT_EQ(encode_submap(*open), encode_submap(*mapper.snapshot_open())) << "looking changes nothing";
  mapper.finish_run();
  EXPECT_EQ(encode_submap(*open), encode_submap(*mapper.take_finished()));
}

// Particles that disagree: the key-frames of the best are there, though the cells do not have them yet.
TEST(MapperSnapshotTest, HoldsTheKeyframesThatAreNotAgreedOn) {
  MapperOptions options;
  options.filter = FilterMode::kRbpf;
  options.particles = 3;
  options.limits.path_m = 100.0;
  options.keyframe_m = 0.05;
  SerialPool pool;
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  for (const Scan& scan : std::span(slow_drive().scans).first(200)) {
    const ScanReport report = mapper.process(scan);
    const std::optional<FinishedSubmap> open = mapper.snapshot_open();
    ASSERT_TRUE(open.has_value());
    ASSERT_EQ(open->keyframes.back().scan_index, report.keyframe_scan_index) << "scan " << scan.index;
    for (std::size_t k = 1; k < open->keyframes.size(); ++k) {
      ASSERT_LT(open->keyframes[k - 1].scan_index, open->keyframes[k].scan_index);
    }
  }
}

// The daemon's recorder takes finished sub-maps while the mapper goes on: same bits as in replay.
TEST(MapperSnapshotTest, AnotherThreadMayTakeFinishedSubmaps) {
  MapperOptions options;
  options.limits.path_m = 4.0;
  const std::span<const Scan> scans = std::span(fast_drive().scans).first(500);
  const MapperRun alone = run_mapper({scans.begin(), scans.end()}, options);
  SerialPool pool;
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  std::vector<FinishedSubmap> taken;
  std::atomic<bool> ended{false};
  std::thread taker([&] {
    while (!ended.load() || mapper.has_finished()) {
      if (std::optional<FinishedSubmap> finished = mapper.take_finished()) taken.push_back(std::move(*finished));
      std::this_thread::yield();
    }
  });
  for (const Scan& scan : scans) {
    mapper.process(scan);
    while (mapper.has_finished()) std::this_thread::yield();  // this test goes at many times real time
  }
  mapper.finish_run();
  ended = true;
  taker.join();
  ASSERT_EQ(taken.size(), alone.submaps.size());
  for (std::size_t i = 0; i < taken.size(); ++i) {
    EXPECT_EQ(encode_submap(taken[i]), encode_submap(alone.submaps[i])) << i;
  }
}

// ---- all filters ----

MapperOptions filter_options(FilterMode mode) {
  MapperOptions options;
  options.filter = mode;
  options.particles = mode == FilterMode::kRbpf ? 10 : 30;
  options.limits.path_m = 2.0;
  return options;
}

// Three particles of which none ever wins: key-frames wait for an agreement by the dozen, then come all at once.
TEST(MapperFilterTest, NoKeyframeIsLostWhenParticlesDisagreeForLong) {
  MapperOptions options = filter_options(FilterMode::kRbpf);
  options.particles = 3;
  options.limits.path_m = 100.0;
  options.limits.keyframes = 20;
  options.keyframe_m = 0.01;
  options.keyframe_rad = 0.005;
  const MapperRun run = run_mapper(slow_drive().scans, options);
  EXPECT_GT(run.counters.keyframes, 150U);
  expect_sound_submaps(run);
}

TEST(MapperFilterTest, AdaptiveTracksASlowDrive) {
  const MapperRun run = run_mapper(slow_drive().scans, filter_options(FilterMode::kAdaptive));
  EXPECT_LT(error_of(run.reports, slow_drive().truth).rms_m, 0.013);  // 6.5 mm
  EXPECT_EQ(run.counters.breaks, 0U);
}

TEST(MapperFilterTest, RbpfTracksASlowDrive) {
  const MapperRun run = run_mapper(slow_drive().scans, filter_options(FilterMode::kRbpf));
  const TrajectoryError error = error_of(run.reports, slow_drive().truth);
  std::printf("rbpf: rms %.1f mm, max %.1f mm\n", 1e3 * error.rms_m, 1e3 * error.max_m);
  EXPECT_LT(error.rms_m, 0.03);
  EXPECT_EQ(run.counters.breaks, 0U);
  expect_sound_submaps(run);
  for (const ScanReport& r : run.reports) EXPECT_EQ(r.particles, 10);
}

// The textbook's filter needs the textbook's odometry: from scans alone 30 particles do not survive 40 Hz.
TEST(MapperFilterTest, FastSlamTracksASlowDriveWithOdometry) {
  const Drive drive = drive_in_office({7.0, 1.0, 0.5, 2, 541, true});
  const MapperRun run = run_mapper(drive.scans, filter_options(FilterMode::kFastSlam));
  const TrajectoryError error = error_of(run.reports, drive.truth);
  std::printf("fastslam: rms %.1f mm, max %.1f mm\n", 1e3 * error.rms_m, 1e3 * error.max_m);
  EXPECT_LT(error.rms_m, 0.10);
  EXPECT_EQ(run.counters.breaks, 0U);
  expect_sound_submaps(run);
}

TEST(MapperFilterTest, OneParticleLastsForManySubmaps) {
  MapperOptions options = filter_options(FilterMode::kRbpf);
  options.particles = 1;
  options.max_adaptive_particles = 1;
  options.limits.path_m = 1.0;
  const MapperRun run = run_mapper(fast_drive().scans, options);
  const TrajectoryError error = error_of(run.reports, fast_drive().truth);
  EXPECT_LT(error.rms_m, 0.1);
  EXPECT_EQ(run.counters.breaks, 0U);
  expect_sound_submaps(run);
}

class MapperThreadsTest : public testing::TestWithParam<FilterMode> {};

TEST_P(MapperThreadsTest, SameBitsForAnyNumberOfThreads) {
  const std::vector<Scan> scans(slow_drive().scans.begin(), slow_drive().scans.begin() + 160);
  const MapperRun one = run_mapper(scans, filter_options(GetParam()), 1);
  for (const int threads : {2, 4}) {
    SCOPED_TRACE(threads);
    const MapperRun run = run_mapper(scans, filter_options(GetParam()), threads);
    ASSERT_EQ(run.reports.size(), one.reports.size());
    for (std::size_t i = 0; i < run.reports.size(); ++i) {
      ASSERT_EQ(run.reports[i].odom_from_base, one.reports[i].odom_from_base) << "scan " << i;
      ASSERT_EQ(run.reports[i].covariance, one.reports[i].covariance) << "scan " << i;
      ASSERT_EQ(run.reports[i].n_eff, one.reports[i].n_eff) << "scan " << i;
    }
    ASSERT_EQ(run.submaps.size(), one.submaps.size());
    for (std::size_t k = 0; k < run.submaps.size(); ++k) {
      ASSERT_EQ(run.submaps[k].blocks.size(), one.submaps[k].blocks.size());
      for (std::size_t b = 0; b < run.submaps[k].blocks.size(); ++b) {
        ASSERT_EQ(run.submaps[k].blocks[b].cells, one.submaps[k].blocks[b].cells);
      }
    }
  }
}

TEST_P(MapperThreadsTest, AnotherSeedIsAnotherRunWhereParticlesAreDrawn) {
  const std::vector<Scan> scans(slow_drive().scans.begin(), slow_drive().scans.begin() + 100);
  MapperOptions options = filter_options(GetParam());
  const MapperRun one = run_mapper(scans, options);
  options.seed = 2;
  const MapperRun two = run_mapper(scans, options);
  bool same = true;
  for (std::size_t i = 0; i < scans.size(); ++i)
    same = same && one.reports[i].odom_from_base == two.reports[i].odom_from_base;
  EXPECT_EQ(same, GetParam() == FilterMode::kAdaptive) << "the seed must reach the particles";
}

INSTANTIATE_TEST_SUITE_P(AllFilters, MapperThreadsTest,
                         testing::Values(FilterMode::kAdaptive, FilterMode::kRbpf, FilterMode::kFastSlam),
                         [](const testing::TestParamInfo<FilterMode>& parameter) {
                           return parameter.param == FilterMode::kAdaptive ? "adaptive"
                                  : parameter.param == FilterMode::kRbpf   ? "rbpf"
                                                                           : "fastslam";
                         });

// Bare walls, but for pilasters about its beginning.
tools::World blank_corridor() {
  std::vector<tools::Segment> walls{{{-60.0, -1.2}, {120.0, -1.2}}, {{-60.0, 1.2}, {120.0, 1.2}}};
  for (const double x : {-58.0, -55.0, -52.0, -49.0, -46.0}) walls.push_back({{x, -1.2}, {x, -0.8}});
  return tools::World(walls);
}

// Scan by scan the heading is off by a milliradian or two, and each time the axis' share of the speed is its cosine.
TEST(MapperTest, KeepsItsSpeedDownABlankCorridor) {
  tools::Route route;
  route.waypoints = {{-58.0, 0.0}, {80.0, 0.0}};
  const Drive drive = drive_through(blank_corridor(), route, {60.0, 2.0, 1.0, 3, 1081});
  const MapperRun run = run_mapper(drive.scans);
  const auto speed_over_truth = [&](std::size_t end) {
    const auto moved = [&](const Pose2& from, const Pose2& to) { return between(from, to).translation().norm(); };
    const std::size_t begin = end - 80;
    return moved(run.reports[begin].odom_from_base, run.reports[end].odom_from_base) /
           moved(drive.truth[begin], drive.truth[end]);
  };
  const std::size_t last = 2200;
  ASSERT_TRUE(run.reports[800].degenerate);
  ASSERT_TRUE(run.reports[last].degenerate);
  EXPECT_NEAR(speed_over_truth(last), speed_over_truth(800), 0.001);
}

// Two poses far down a blank corridor share what nobody knows of the way there: the step between them is known.
TEST(MapperTest, StepsInABlankCorridorAreSurerThanThePlace) {
  tools::Route route;
  route.waypoints = {{-58.0, 0.0}, {-20.0, 0.0}};
  const Drive drive = drive_through(blank_corridor(), route, {20.0, 2.0, 1.0, 3, 1081});
  const MapperRun run = run_mapper(drive.scans);
  double steps_m2 = 0.0;
  double widest_m = 0.0;
  for (const FinishedSubmap& submap : run.submaps) {
    for (const Keyframe& keyframe : submap.keyframes) {
      if (!keyframe.degenerate || keyframe.scan_index < 100) continue;
      widest_m = std::max(widest_m, std::sqrt(keyframe.step_covariance(0, 0)));
      steps_m2 += keyframe.step_covariance(0, 0);
    }
  }
  const ScanReport& last = run.reports.back();
  ASSERT_TRUE(last.degenerate);
  const double place_m = std::sqrt(last.covariance.topLeftCorner<2, 2>().trace());
  EXPECT_GT(place_m, 2.0);
  EXPECT_LT(widest_m, 0.3 * place_m);
  EXPECT_GT(std::sqrt(steps_m2), 0.7 * place_m) << "together they are as unsure as the place";
  EXPECT_LT(std::sqrt(steps_m2), 2.0 * place_m);
}

}  // namespace
}  // namespace submapd
