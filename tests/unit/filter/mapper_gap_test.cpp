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

TEST(MapperGapTest, RecoversAfterAGapOfASecond) {
  Drive drive = fast_drive();
  // From 6 s on the cart drives at speed.
  const std::ptrdiff_t from = 6 * 40;
  ASSERT_GT(std::hypot(drive.truth[280].x - drive.truth[240].x, drive.truth[280].y - drive.truth[240].y), 0.5)
      << "it moves";
  drive.scans.erase(drive.scans.begin() + from, drive.scans.begin() + from + 40);
  drive.truth.erase(drive.truth.begin() + from, drive.truth.begin() + from + 40);
  const MapperRun run = run_mapper(drive.scans);
  const TrajectoryError error = error_of(run.reports, drive.truth);
  std::printf("after a gap: rms %.1f mm, %d lost\n", 1e3 * error.rms_m, static_cast<int>(run.counters.lost_scans));
  EXPECT_LT(error.rms_m, 0.05);
  EXPECT_EQ(run.counters.breaks, 0U);
  expect_sound_submaps(run);
}

}  // namespace
}  // namespace submapd
