// Time that the mapper has not seen: scans that are missing, a run that was cut off, a cart that was carried away.
#include "tests/unit/filter/mapper_rig.hpp"

namespace submapd {
namespace {

using namespace test;  // the rig

TEST(MapperGapTest, CutOffItGoesOnFromTheLastFinishedSubmapAsIfNothingHadBeen) {
  const Drive& drive = fast_drive();
  for (const std::size_t cut : {450UL, 621UL}) {
    const MapperRun run = run_mapper_cut_off(drive.scans, cut, 0, short_submaps());
    expect_sound_submaps(run);
    EXPECT_EQ(run.counters.breaks, 0U);
    EXPECT_EQ(run.reports.size(), drive.scans.size());
    EXPECT_LT(error_of(run.reports, drive.truth).rms_m, kDriveLimit_m) << cut;
    for (const FinishedSubmap& submap : run.submaps) EXPECT_TRUE(submap.linked_to_previous);
  }
}

TEST(MapperGapTest, AfterTwoSecondsThatNobodySawItFindsItsPlaceAgain) {
  const Drive& drive = fast_drive();
  const MapperRun run = run_mapper_cut_off(drive.scans, 500, 80, short_submaps());
  expect_sound_submaps(run);
  EXPECT_EQ(run.counters.breaks, 0U);
  EXPECT_LT(error_of(run.reports, truth_of(drive, run.reports)).rms_m, 2.0 * kDriveLimit_m);
}

TEST(MapperGapTest, WhereNothingLooksAsBeforeASubmapWithoutALinkBegins) {
  Drive drive = fast_drive();
  // Carried away: the scans of the drive's end follow those of its beginning.
  drive.scans.erase(drive.scans.begin() + 450, drive.scans.begin() + 700);
  std::int64_t stamp_us = drive.scans[449].stamp_us + 2'000'000;
  for (std::size_t i = 450; i < drive.scans.size(); ++i) {
    drive.scans[i].stamp_us = stamp_us += 25'000;
    drive.scans[i].index = i;
  }
  const MapperRun run = run_mapper_cut_off(drive.scans, 450, 0, short_submaps());
  expect_sound_submaps(run);
  EXPECT_EQ(std::count_if(run.submaps.begin(), run.submaps.end(),
                          [](const FinishedSubmap& s) { return !s.linked_to_previous; }),
            1);
}

// Scans [from, from + count) of the drive, at speed, do not come.
Drive drive_without(std::ptrdiff_t from, std::ptrdiff_t count) {
  Drive drive = fast_drive();
  const auto at = static_cast<std::size_t>(from);
  EXPECT_GT((drive.truth[at].translation() - drive.truth[at + 40].translation()).norm(), 0.5) << "it moves";
  drive.scans.erase(drive.scans.begin() + from, drive.scans.begin() + from + count);
  drive.truth.erase(drive.truth.begin() + from, drive.truth.begin() + from + count);
  return drive;
}

TEST(MapperGapTest, RecoversAfterScansThatDidNotCome) {
  for (const std::ptrdiff_t count : {40, 80}) {
    const Drive drive = drive_without(240, count);
    const MapperRun run = run_mapper(drive.scans);
    EXPECT_LT(error_of(run.reports, drive.truth).rms_m, 2.0 * kDriveLimit_m) << count;
    EXPECT_EQ(run.counters.breaks, 0U) << count;
    expect_sound_submaps(run);
  }
}

TEST(MapperGapTest, RecoversAfterScansThatSawNothing) {
  Drive drive = fast_drive();
  for (std::size_t i = 240; i < 320; ++i) std::ranges::fill(drive.scans[i].ranges_mm, kErrorCode_mm);
  const MapperRun run = run_mapper(drive.scans);
  EXPECT_EQ(run.counters.breaks, 0U);
  const std::size_t after = 322;
  const std::span<const ScanReport> reports = run.reports;
  EXPECT_LT(error_of(reports.subspan(after), std::span(drive.truth).subspan(after)).rms_m, 2.0 * kDriveLimit_m);
  const Pose2 off = between(between(reports[200].odom_from_base, reports[400].odom_from_base),
                            between(drive.truth[200], drive.truth[400]));
  EXPECT_LT(off.translation().norm(), 0.03);
}

// Of a slow log every 20th scan, i.e. two a second, with its odometry. One scan is mixed with an older one, while the
// cart turns.
TEST(MapperGapTest, AScanThatFitsBadlyIsNotMadePartOfASlowMap) {
  Drive fast = drive_in_office({20.0, 1.0, 1.0, 3, 181, true});
  Drive drive;
  for (std::size_t i = 0; i < fast.scans.size(); i += 20) {
    drive.truth.push_back(fast.truth[i]);
    drive.scans.push_back(std::move(fast.scans[i]));
    drive.scans.back().index = drive.scans.size() - 1;
  }
  std::size_t turning = 0;
  double most_rad = 0.0;
  for (std::size_t i = 12; i < drive.truth.size(); ++i) {
    const double turned_rad = std::abs(between(drive.truth[i - 2], drive.truth[i]).yaw);
    if (turned_rad > most_rad) {
      most_rad = turned_rad;
      turning = i;
    }
  }
  ASSERT_GT(most_rad, 0.5);
  // Half of its beams are those of two scans ago.
  std::copy_n(drive.scans[turning - 2].ranges_mm.begin(), 95, drive.scans[turning].ranges_mm.begin());
  const MapperRun run = run_mapper(drive.scans);
  EXPECT_FALSE(run.reports[turning].lost);
  EXPECT_FALSE(run.reports[turning].keyframe) << run.reports[turning].health.matched_ratio;
  ASSERT_LT(turning + 1, run.reports.size());
  EXPECT_LT(error_of(std::span(run.reports).subspan(turning + 1), std::span(drive.truth).subspan(turning + 1)).rms_m,
            0.05);
  expect_sound_submaps(run);
}

TEST(MapperGapTest, LiftedBetweenTwoScansItBeginsASubmapWithoutALinkAtOnce) {
  Drive drive = fast_drive();
  ASSERT_GT((drive.truth[449].translation() - drive.truth[700].translation()).norm(), 3.0);
  drive.scans.erase(drive.scans.begin() + 450, drive.scans.begin() + 700);
  std::int64_t stamp_us = drive.scans[449].stamp_us;
  for (std::size_t i = 450; i < drive.scans.size(); ++i) drive.scans[i].stamp_us = stamp_us += 25'000;
  for (const bool standing_odometry : {false, true}) {  // some logs have an odometry that never moves
    for (Scan& scan : drive.scans) scan.odometry = standing_odometry ? std::optional(Pose2{}) : std::nullopt;
    const MapperRun run = run_mapper(drive.scans, short_submaps());
    EXPECT_EQ(run.counters.breaks, 1U);
    EXPECT_FALSE(run.reports[450].lost);
    EXPECT_TRUE(run.reports[450].keyframe);
    EXPECT_FALSE(run.reports[450].keyframe_linked);
    expect_sound_submaps(run);
  }
}

}  // namespace
}  // namespace submapd
