#include "tools/replay/seam.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace submapd::tools {
namespace {

using ::testing::ElementsAre;

// Straight on, 0.1 m a scan; the chunk before has key-frames at even scans, the next one at every fifth.
constexpr double kStep_m = 0.1;

Keyframe keyframe(std::uint64_t scan_index, double x) {
  Keyframe k;
  k.scan_index = scan_index;
  k.stamp_us = static_cast<std::int64_t>(scan_index) * 25'000;
  k.pose = {x, 0.0, 0.0};
  k.step_covariance = 1e-6 * Eigen::Matrix3d::Identity();
  return k;
}

FinishedSubmap submap_of(std::uint64_t first, std::uint64_t end, std::uint64_t stride) {
  FinishedSubmap submap;
  for (std::uint64_t scan = first; scan < end; scan += stride) {
    submap.keyframes.push_back(keyframe(scan, kStep_m * static_cast<double>(scan - first)));
  }
  return submap;
}

// Scans 20..39, each by the even one at or before it.
std::vector<SeamPose> seam() {
  std::vector<SeamPose> poses;
  for (std::uint64_t scan = 20; scan < 40; ++scan) {
    SeamPose pose;
    pose.scan_index = scan;
    pose.keyframe_scan_index = scan - scan % 2;
    pose.keyframe_from_base = {kStep_m * static_cast<double>(scan % 2), 0.0, 0.0};
    pose.covariance = 4e-6 * Eigen::Matrix3d::Identity();
    poses.push_back(pose);
  }
  return poses;
}

std::vector<std::uint64_t> scans_of(const FinishedSubmap& submap) {
  std::vector<std::uint64_t> scans;
  for (const Keyframe& k : submap.keyframes) scans.push_back(k.scan_index);
  return scans;
}

TEST(Seam, TheNextChunksKeyframesStandWhereThisOneSawThem) {
  FinishedSubmap last = submap_of(10, 40, 2);
  EXPECT_EQ(share_seam(last, seam(), submap_of(20, 60, 5)), 4U);
  EXPECT_THAT(scans_of(last), ElementsAre(10, 12, 14, 16, 18, 20, 25, 30, 35));
  for (const Keyframe& k : last.keyframes) {
    EXPECT_NEAR(k.pose.x, kStep_m * static_cast<double>(k.scan_index - 10), 1e-12) << k.scan_index;
  }
  // As uncertain as the two matches it is made of.
  EXPECT_NEAR(last.keyframes[6].step_covariance(0, 0), 8e-6, 1e-12);
}

TEST(Seam, ScansThatWereLostTieNothing) {
  FinishedSubmap last = submap_of(10, 40, 2);
  std::vector<SeamPose> poses = seam();
  for (SeamPose& pose : poses) pose.lost = true;
  EXPECT_EQ(share_seam(last, poses, submap_of(20, 60, 5)), 0U);
  EXPECT_THAT(scans_of(last), ElementsAre(10, 12, 14, 16, 18));
}

TEST(Seam, ASubmapThatClosedInTheSeamSharesUntilThen) {
  FinishedSubmap before_last = submap_of(0, 30, 2);
  EXPECT_EQ(share_seam(before_last, seam(), submap_of(20, 60, 5)), 2U);
  EXPECT_EQ(before_last.keyframes.back().scan_index, 25U);
}

TEST(Seam, TheLastChunkOfALogHasNone) {
  FinishedSubmap last = submap_of(10, 40, 2);
  const auto scans = scans_of(last);
  EXPECT_EQ(share_seam(last, {}, submap_of(20, 60, 5)), 0U);
  EXPECT_EQ(scans_of(last), scans);
}

}  // namespace
}  // namespace submapd::tools
