// Recorded logs of slow scanners: a few scans a second, half the beams, and stamps that tell when a scan arrived.
#include "tests/unit/filter/mapper_rig.hpp"

namespace submapd {
namespace {

using namespace test;  // the rig

constexpr int kEach = 16;  // of forty scans a second, two and a half are left

// Forty seconds with turns, up to 0.9 m/s: up to 0.4 m and 30 degrees from scan to scan.
Drive recorded_drive() {
  const Drive whole = drive_in_office({40.0, 0.9, 0.5, 3, 361});
  Drive drive;
  for (std::size_t i = 0; i < whole.scans.size(); i += kEach) {
    drive.scans.push_back(whole.scans[i]);
    drive.scans.back().index = drive.truth.size();
    drive.scans.back().geometry.sweep_s = 0.0;  // such logs do not tell
    drive.truth.push_back(whole.truth[i]);
  }
  return drive;
}

void expect_tracked(const Drive& drive, double rms_m) {
  const MapperRun run = run_mapper(drive.scans);
  expect_sound_submaps(run);
  EXPECT_EQ(run.counters.breaks, 0U);
  EXPECT_EQ(run.counters.lost_scans, 0U);
  EXPECT_LT(error_of(run.reports, drive.truth).rms_m, rms_m);
}

TEST(MapperSlowTest, TracksWithTrueStamps) {
  expect_tracked(recorded_drive(), 0.02);  // 10 mm
}

// As in the last minutes of the Intel log: for two seconds nothing, and then all that was scanned meanwhile.
TEST(MapperSlowTest, TracksWithStampsInBursts) {
  Drive drive = recorded_drive();
  const std::size_t n = drive.scans.size();
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t last = std::min(i - i % 6 + 5, n - 1);
    drive.scans[i].stamp_us = drive.scans[last].stamp_us + static_cast<std::int64_t>(2'000 * (i % 6));
  }
  expect_tracked(drive, 0.1);  // 64 mm
}

// As at its beginning: what was scanned before the cart went is stamped as if it were one fast scanner's.
TEST(MapperSlowTest, AFastBeginningMakesNoFastLog) {
  Drive drive = recorded_drive();
  Drive standing;
  for (int k = 0; k < 30; ++k) {
    standing.scans.push_back(drive.scans.front());
    standing.scans.back().stamp_us += 2'000 * k - 10'000'000;
    standing.truth.push_back(drive.truth.front());
  }
  drive.scans.insert(drive.scans.begin(), standing.scans.begin(), standing.scans.end());
  drive.truth.insert(drive.truth.begin(), standing.truth.begin(), standing.truth.end());
  for (std::size_t i = 0; i < drive.scans.size(); ++i) drive.scans[i].index = i;
  expect_tracked(drive, 0.02);  // 11 mm
}

// As in the middle of the Intel log: now and then a scan is stamped a quarter of its time after the one before it. Its
// motion made a twist beyond any cart's, and the next scan was sought behind the cart.
TEST(MapperSlowTest, AScanStampedTooEarlyTeachesNoSpeed) {
  Drive drive = recorded_drive();
  for (std::size_t i = 3; i < drive.scans.size(); i += 7) {
    drive.scans[i].stamp_us = drive.scans[i - 1].stamp_us + 100'000;
  }
  expect_tracked(drive, 0.02);  // 10 mm
  for (const FinishedSubmap& submap : run_mapper(drive.scans).submaps) {
    for (const Keyframe& k : submap.keyframes) EXPECT_LT(std::hypot(k.twist.vx, k.twist.vy), 2.0) << k.scan_index;
  }
}

// Scans are missing here and there: a step takes once or twice the period, and its time says which.
TEST(MapperSlowTest, TracksWithScansMissing) {
  Drive drive = recorded_drive();
  Drive left;
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    if (i % 5 == 4) continue;
    left.scans.push_back(drive.scans[i]);
    left.scans.back().index = left.truth.size();
    left.truth.push_back(drive.truth[i]);
  }
  expect_tracked(left, 0.02);  // 10 mm
}

}  // namespace
}  // namespace submapd
