// The spool of poses while somebody else adds, and the marks that are laid on the optimised path.
#include "slam/output/run_outputs.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <thread>

#include "slam/output/trajectory_file.hpp"
#include "tests/support/random_submap.hpp"
#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

SpooledPose pose_number(std::uint64_t i) {
  return {static_cast<std::int64_t>(i), i, {static_cast<double>(i), 0.0, 0.0}, {}, false, false};
}

TEST(PoseSpoolTest, ReadsWhatIsThereWhileMoreIsAdded) {
  const ScratchFolder folder;
  const Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::create(folder.path());
  ASSERT_TRUE(spool.has_value());
  EXPECT_EQ(folder.entries(), 0U) << "the file has no name";
  constexpr std::uint64_t kPoses = 5000;
  std::thread adder([&] {
    for (std::uint64_t i = 0; i < kPoses; ++i) ASSERT_TRUE((*spool)->add(pose_number(i)).ok());
  });
  std::uint64_t seen = 0;
  while (seen < kPoses) {
    seen = (*spool)->size();
    std::uint64_t next = 0;
    ASSERT_TRUE((*spool)
                    ->for_each(seen,
                               [&](const SpooledPose& pose) {
                                 EXPECT_EQ(pose.keyframe_scan_index, next);
                                 EXPECT_EQ(pose.keyframe_from_base.x, static_cast<double>(next++));
                                 return Status();
                               })
                    .ok());
    ASSERT_EQ(next, seen);
  }
  adder.join();
  const Status told = (*spool)->for_each(10, [](const SpooledPose&) { return Status(StatusCode::kIo, "enough"); });
  EXPECT_EQ(told.message(), "enough");
  EXPECT_FALSE((*spool)->for_each(kPoses + 1, [](const SpooledPose&) { return Status(); }).ok());
}

std::vector<SpooledPose> poses_in(const PoseSpool& spool) {
  std::vector<SpooledPose> poses;
  EXPECT_TRUE(spool
                  .for_each(spool.size(),
                            [&](const SpooledPose& pose) {
                              poses.push_back(pose);
                              return Status();
                            })
                  .ok());
  return poses;
}

TEST(PoseSpoolTest, OpenedAgainItGoesOnBehindTheLastWholeRecord) {
  const ScratchFolder folder;
  const std::filesystem::path path = folder.path() / "poses";
  {
    Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::open(path);
    ASSERT_TRUE(spool.has_value()) << spool.error().message();
    for (std::uint64_t i = 0; i < 600; ++i) ASSERT_TRUE((*spool)->add(pose_number(i)).ok());
    ASSERT_TRUE((*spool)->sync().ok());
  }
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);  // as a power cut leaves it
  {
    Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::open(path);
    ASSERT_TRUE(spool.has_value());
    EXPECT_EQ((*spool)->size(), 599U);
    EXPECT_EQ((*spool)->last_stamp_us(), 598);
  }
  std::filesystem::resize_file(path, std::filesystem::file_size(path) + 500);  // or zeros
  {
    Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::open(path);
    ASSERT_TRUE(spool.has_value());
    ASSERT_TRUE((*spool)->keep_until(299).ok());
    EXPECT_EQ((*spool)->size(), 300U) << "what is later is mapped again";
    EXPECT_EQ((*spool)->last_stamp_us(), 299);
    ASSERT_TRUE((*spool)->add({300, 7, {1.0, 2.0, 3.0}, {4.0, 5.0, 6.0}, true, true}).ok());
    const std::vector<SpooledPose> poses = poses_in(**spool);
    ASSERT_EQ(poses.size(), 301U);
    EXPECT_EQ(poses[299].keyframe_scan_index, 299U);
    EXPECT_EQ(poses[300].keyframe_from_base.yaw, 3.0);
    EXPECT_EQ(poses[300].previous_keyframe_from_base.x, 4.0);
    EXPECT_TRUE(poses[300].keyframe && poses[300].linked);
  }
  EXPECT_EQ(std::filesystem::file_size(path), 16U + 301U * 72U);
  {
    Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::open(path);
    ASSERT_TRUE(spool.has_value());
    ASSERT_TRUE((*spool)->keep_until(-1).ok());
    EXPECT_EQ((*spool)->size(), 0U);
    EXPECT_EQ((*spool)->last_stamp_us(), std::numeric_limits<std::int64_t>::min()) << "there is none";
  }
  std::filesystem::resize_file(path, 3);
  EXPECT_EQ((*PoseSpool::open(path))->size(), 0U) << "begun, and no more";
  std::ofstream(path) << std::string(100, 'x');
  const Expected<std::unique_ptr<PoseSpool>> other = PoseSpool::open(path);
  ASSERT_FALSE(other.has_value());
  EXPECT_EQ(other.error().code(), StatusCode::kCorrupt) << "not ours";
}

// Two key-frames, 1 m and 1 s apart, three scans.
class RunOutputsTest : public testing::Test {
 protected:
  class OneSubmap final : public SubmapSource {
   public:
    explicit OneSubmap(FinishedSubmap submap) : submap_(std::make_shared<const FinishedSubmap>(std::move(submap))) {}
    Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t) override { return submap_; }

   private:
    std::shared_ptr<const FinishedSubmap> submap_;
  };

  RunOutputsTest() : spool(*PoseSpool::create(folder.path())) {
    result.submaps = {{0, {}}};
    result.keyframes = {{0, 1'000'000, {0.0, 0.0, 0.0}}, {40, 2'000'000, {1.0, 0.0, 0.0}}};
    EXPECT_TRUE(spool->add({1'000'000, 0, {}, {}, true, false}).ok());
    EXPECT_TRUE(spool->add({1'500'000, 0, {0.4, 0.0, 0.0}, {}, false, false}).ok());
    EXPECT_TRUE(spool->add({2'000'000, 40, {}, {0.8, 0.0, 0.0}, true, true}).ok());
  }
  Expected<RunOutputsSummary> write(std::uint64_t scans, std::vector<Mark> marks) {
    FinishedSubmap submap = random_submap(1, {{}, {}, 0}, {});
    submap.keyframes.resize(1);
    submap.keyframes[0].scan_index = 0;
    OneSubmap source(std::move(submap));
    return write_run_outputs({.folder = folder.path(),
                              .name = "test",
                              .subtitle = "",
                              .mapper = options,
                              .raster_bytes = 1U << 22,
                              .result = result,
                              .submaps = source,
                              .poses = *spool,
                              .scans = scans,
                              .marks = std::move(marks)});
  }

  ScratchFolder folder;
  std::unique_ptr<PoseSpool> spool;
  FinalResult result;
  MapperOptions options;
};

TEST_F(RunOutputsTest, MarksLieBetweenTheScansAboutThem) {
  // A second sub-map begins at 1.5 s where the first did, its heading sure to 0.1 rad, its place to 0.3 m across.
  result.submaps.push_back({1, {}});
  const Eigen::Vector3d variances(0.0, 0.09, 0.01);
  result.bounds = {{1'000'000, Eigen::Matrix3d::Zero()}, {1'500'000, variances.asDiagonal()}};
  const auto written =
      write(3, {{"early", 999'999}, {"start", 1'000'001}, {"way", 1'250'000}, {"end", 2'000'000}, {"late", 2'000'001}});
  ASSERT_TRUE(written.has_value()) << written.error().message();
  EXPECT_DOUBLE_EQ(written->path_m, 1.0);
  // The filter saw 0.8 m where the optimised key-frames are 1 m apart: half of the way 0.4 + 0.1.
  EXPECT_EQ(read_text(folder.path() / "marks.csv"),
            "name,utime_us,x_m,y_m,yaw_rad,sigma_m,sigma_rad\n"
            "start,1000001,0.000001,0.000000,0.00000000,0.0000,0.000000\n"
            "way,1250000,0.250000,0.000000,0.00000000,0.0000,0.000000\n"
            "end,2000000,1.000000,0.000000,0.00000000,0.3162,0.100000\n");
  EXPECT_NEAR(written->quality.bend_m, 0.2, 1e-9) << "the filter had 0.8 m";
}

TEST_F(RunOutputsTest, ScansBeyondTheResultAreLeftOut) {
  result.keyframes.pop_back();
  EXPECT_TRUE(spool->add({3'000'000, 80, {}, {}, true, false}).ok());
  EXPECT_EQ(write(4, {}).error().code(), StatusCode::kInternal) << "a key-frame that follows none with a pose";
  const auto written = write(2, {});
  ASSERT_TRUE(written.has_value()) << written.error().message();
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "marks.csv"));
}

// Condensed sub-maps have one optimised key-frame each. The filter saw 0.8 m, and then 0.8 m; the next key-frame that
// is optimised lies 2 m ahead: what is missing is spread over the time between.
TEST_F(RunOutputsTest, KeyframesOfCondensedSubmapsGoTheFiltersWay) {
  result.keyframes = {{0, 1'000'000, {0.0, 0.0, 0.0}}, {80, 3'000'000, {2.0, 0.0, 0.0}}};
  EXPECT_TRUE(spool->add({3'000'000, 80, {}, {0.8, 0.0, 0.0}, true, true}).ok());
  EXPECT_TRUE(spool->add({3'500'000, 80, {0.4, 0.0, 0.0}, {}, false, false}).ok());
  const auto written = write(5, {});
  ASSERT_TRUE(written.has_value()) << written.error().message();
  const auto lines = read_tum(folder.path() / "trajectory.tum");
  ASSERT_TRUE(lines.has_value());
  ASSERT_EQ(lines->size(), 5U);
  const std::vector<double> expected{0.0, 0.5, 1.0, 2.0, 2.4};
  for (std::size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR((*lines)[k].pose.x, expected[k], 1e-6) << k;
}

// A disk that was full may have cost the record of a key-frame: its scans are left out, not the map.
TEST_F(RunOutputsTest, ScansOfAKeyframeThatIsNotInTheSpoolAreLeftOut) {
  EXPECT_TRUE(spool->add({3'100'000, 80, {0.1, 0.0, 0.0}, {}, false, false}).ok());  // its key-frame was not spooled
  EXPECT_TRUE(spool->add({4'000'000, 120, {}, {1.0, 0.0, 0.0}, true, true}).ok());
  result.keyframes.push_back({120, 4'000'000, {3.0, 0.0, 0.0}});
  const auto written = write(5, {});
  ASSERT_TRUE(written.has_value()) << written.error().message();
  const auto lines = read_tum(folder.path() / "trajectory.tum");
  ASSERT_TRUE(lines.has_value());
  ASSERT_EQ(lines->size(), 4U);
  EXPECT_NEAR(lines->back().pose.x, 3.0, 1e-6);
}

}  // namespace
}  // namespace submapd
