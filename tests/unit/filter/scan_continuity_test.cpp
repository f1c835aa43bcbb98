// What tells a cart that was lifted from one that was driven, and from people in its way.
#include "slam/filter/internal/scan_continuity.hpp"

#include "tests/unit/filter/mapper_rig.hpp"

namespace submapd {
namespace {

using namespace test;  // the rig

ScanContinuity::Change change_between(const Scan& before, const Scan& now, const Pose2& before_from_now) {
  ScanPoints points({}, 2048);
  ScanContinuity continuity;
  points.assign(before, {});
  continuity.keep(points);
  points.assign(now, {});
  return continuity.compare(points, before_from_now);
}

TEST(ScanContinuityTest, ADrivenCartSeesTheSameThroughout) {
  const Drive& drive = fast_drive();
  for (std::size_t i = 1; i < drive.scans.size(); i += 7) {
    // Predicted by the motion before, not by the one that is asked about.
    const Pose2 motion = between(drive.truth[i - 1], drive.truth[i]);
    const ScanContinuity::Change change = change_between(drive.scans[i - 1], drive.scans[i], motion);
    EXPECT_GT(change.same, 0.75) << "scan " << i;
    EXPECT_GT(change.compared, 100);
  }
}

TEST(ScanContinuityTest, ALiftedCartSeesOtherThingsAndOpenedViews) {
  const Drive& drive = fast_drive();
  int tried = 0;
  for (std::size_t i = 0; i + 250 < drive.scans.size(); i += 50) {
    if ((drive.truth[i].translation() - drive.truth[i + 250].translation()).norm() < 4.0) continue;
    ++tried;
    const ScanContinuity::Change change = change_between(drive.scans[i], drive.scans[i + 250], {});
    EXPECT_LT(change.same, 0.5) << "scan " << i;
    EXPECT_GT(change.farther, 0.1) << "scan " << i;
  }
  EXPECT_GE(tried, 4);
}

TEST(ScanContinuityTest, WhoStepsInFrontOfTheScannerOpensNoView) {
  const Scan& before = fast_drive().scans[300];
  Scan now = before;
  for (std::size_t i = 200; i < 900; ++i) now.ranges_mm[i] = std::min<std::uint16_t>(now.ranges_mm[i], 600);
  const ScanContinuity::Change change = change_between(before, now, {});
  EXPECT_LT(change.same, 0.8);
  EXPECT_LT(change.farther, 0.02);
}

TEST(ScanContinuityTest, WithoutAScanBeforeNothingIsCompared) {
  ScanPoints points({}, 2048);
  points.assign(fast_drive().scans[0], {});
  const ScanContinuity continuity;
  EXPECT_EQ(continuity.compare(points, {}).compared, 0);
}

}  // namespace
}  // namespace submapd
