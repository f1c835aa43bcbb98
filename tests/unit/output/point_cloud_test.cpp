// A cloud of a box-shaped room, taken while the cart drives an arc: every point lies on a wall, the floor or the
// ceiling.
#include "slam/output/point_cloud.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kStart_us = 1'700'000'000'000'000;
constexpr std::int64_t kPeriod_us = 25'000;
constexpr double kSweep_s = 0.01875;
const Eigen::Array3d kLow{-6.0, -5.0, 0.0};
const Eigen::Array3d kHigh{7.0, 5.5, 2.6};

Pose2 truth(double time_s) {
  return compose(Pose2{-2.0, -1.0, 0.4}, exp_twist({0.9, 0.05, 0.35}, time_s));
}

struct Point {
  Eigen::Vector3f at;
  double time = 0.0;
  std::uint16_t intensity = 0;
};

// The points of a file, whose header must announce them and nothing else.
std::vector<Point> read_cloud(const std::filesystem::path& path, bool intensities) {
  const std::string text = read_text(path);
  const std::size_t end = text.find("end_header\n") + 11;
  const std::size_t size = 20 + (intensities ? 2 : 0);
  std::size_t count = 0;
  EXPECT_EQ(std::sscanf(text.c_str() + text.find("element vertex"), "element vertex %zu", &count), 1);
  EXPECT_EQ(text.size(), end + count * size);
  EXPECT_EQ(text.find("intensity") != std::string::npos, intensities);
  std::vector<Point> points(count);
  for (std::size_t i = 0; i < count && end + (i + 1) * size <= text.size(); ++i) {
    const char* const bytes = text.data() + end + i * size;
    std::memcpy(points[i].at.data(), bytes, 12);
    std::memcpy(&points[i].time, bytes + 12, 8);
    if (intensities) std::memcpy(&points[i].intensity, bytes + 20, 2);
  }
  return points;
}

class PointCloudTest : public testing::Test {
 protected:
  class Scans final : public CloudScans {
   public:
    explicit Scans(const std::vector<CloudScan>& all) : scans_(all) {}
    Expected<std::optional<CloudScan>> next() override {
      return next_ < scans_.size() ? std::optional(scans_[next_++]) : std::nullopt;
    }

   private:
    std::vector<CloudScan> scans_;
    std::size_t next_ = 0;
  };

  PointCloudTest() : spool(*PoseSpool::create(folder.path())) {
    mount.x_m = -0.3;
    mount.y_m = 0.12;
    mount.z_m = 1.1;
    mount.roll_rad = 0.05;
    mount.pitch_rad = -1.5;
    mount.yaw_rad = 0.1;
  }
  // A key-frame every tenth scan; scans in [gap_from, gap_to) are missing.
  void drive(int poses, int gap_from = 0, int gap_to = 0) {
    Pose2 keyframe;
    for (int i = 0; i < poses; ++i) {
      if (i >= gap_from && i < gap_to) continue;
      const std::int64_t stamp_us = kStart_us + i * kPeriod_us;
      const Pose2 pose = truth(0.025 * i);
      const auto index = static_cast<std::uint64_t>(i - i % 10);
      const bool is_keyframe = i % 10 == 0;
      if (is_keyframe) {
        result.keyframes.push_back({index, stamp_us, pose});
        EXPECT_TRUE(spool->add({stamp_us, index, {}, between(keyframe, pose), true, i > 0}).ok());
        keyframe = pose;
      } else {
        EXPECT_TRUE(spool->add({stamp_us, index, between(keyframe, pose), {}, false, false}).ok());
      }
    }
  }
  // What the scanner sees on the way, from before the first pose to after the last.
  void scan(int count, bool intensities = false) {
    for (int n = -2; n < count; ++n) {
      CloudScan cloud;
      Scan& s = cloud.scan;
      s.stamp_us = kStart_us + 7'000 + n * kPeriod_us;
      s.index = static_cast<std::uint64_t>(n + 2);
      s.geometry.sweep_s = kSweep_s;
      for (int i = 0; i < 1081; ++i) {
        const double time_s = 1e-6 * static_cast<double>(s.stamp_us - kStart_us) + kSweep_s * i / 1080.0;
        s.ranges_mm.push_back(range_mm(time_s, s.geometry.first_angle_rad + i * s.geometry.angle_step_rad));
        if (intensities) cloud.intensities.push_back(static_cast<std::uint16_t>(60'000 + i));
      }
      s.ranges_mm[3] = kNoReturn_mm;
      s.ranges_mm[4] = kErrorCode_mm;
      s.ranges_mm[5] = 50;      // the cart itself
      s.ranges_mm[6] = 40'000;  // beyond its range
      scans.push_back(std::move(cloud));
    }
  }
  [[nodiscard]] std::uint16_t range_mm(double time_s, double angle) const {
    const Pose2 base = truth(time_s);
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() = rotation(base.yaw);
    const Eigen::Vector3d from = turn * mount.translation() + Eigen::Vector3d(base.x, base.y, 0.0);
    const Eigen::Vector3d ray = turn * mount.rotation() * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.0);
    double range = std::numeric_limits<double>::infinity();
    for (int i = 0; i < 3; ++i) {
      if (ray[i] > 1e-9) range = std::min(range, (kHigh[i] - from[i]) / ray[i]);
      if (ray[i] < -1e-9) range = std::min(range, (kLow[i] - from[i]) / ray[i]);
    }
    return static_cast<std::uint16_t>(std::lround(1000.0 * range));
  }
  [[nodiscard]] OpenCloudScans open() const {
    return [this]() -> Expected<std::unique_ptr<CloudScans>> { return std::make_unique<Scans>(scans); };
  }
  [[nodiscard]] OptimizedTrajectory trajectory() const {
    return *OptimizedTrajectory::make(result, *spool, spool->size());
  }
  [[nodiscard]] Status write(const CloudSize& size) const {
    return write_cloud(path(), size, trajectory(), mount, open(), [](double share) { EXPECT_LE(share, 1.0); });
  }
  [[nodiscard]] std::filesystem::path path() const { return folder.path() / "cloud.ply"; }

  ScratchFolder folder;
  std::unique_ptr<PoseSpool> spool;
  FinalResult result;
  ScannerMount mount;
  std::vector<CloudScan> scans;
};

TEST(ScannerMountTest, ByDefaultItLooksUpAndItsLeftIsLeft) {
  const Eigen::Matrix3d turn = ScannerMount{}.rotation();
  EXPECT_LT((turn.col(0) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
  EXPECT_LT((turn.col(1) - Eigen::Vector3d::UnitY()).norm(), 1e-12);
}

TEST_F(PointCloudTest, EveryPointLiesOnTheRoom) {
  drive(161);
  scan(170, true);
  const Expected<CloudSize> size = measure_cloud(trajectory(), mount, open());
  ASSERT_TRUE(size.has_value());
  EXPECT_TRUE(size->intensities);
  EXPECT_EQ(size->scans, 161U) << "the first one began before the first pose";
  EXPECT_GT(size->points, 159U * 1077U);
  EXPECT_LT(size->points, 161U * 1077U);
  scans.push_back(scans.back());  // more come while it is written
  ASSERT_TRUE(write(*size).ok());
  EXPECT_EQ(std::filesystem::file_size(path()), size->bytes());
  double last = 0.0;
  for (const Point& point : read_cloud(path(), true)) {
    const Eigen::Array3d at = point.at.cast<double>();
    const double off = std::min((at - kLow).abs().minCoeff(), (at - kHigh).abs().minCoeff());
    ASSERT_LT(off, 0.0015) << at.transpose();
    ASSERT_GE(point.intensity, 60'000);
    ASSERT_GE(point.time, last);
    last = point.time;
  }
  EXPECT_NEAR(last, 1e-6 * static_cast<double>(kStart_us) + 160 * 0.025, 1e-4);
}

TEST_F(PointCloudTest, WithTheWrongMountItDoesNot) {
  drive(41);
  scan(41);
  mount.yaw_rad = -0.1;
  const Expected<CloudSize> size = measure_cloud(trajectory(), mount, open());
  ASSERT_TRUE(size.has_value() && write(*size).ok());
  double worst = 0.0;
  for (const Point& point : read_cloud(path(), false)) {
    const Eigen::Array3d at = point.at.cast<double>();
    worst = std::max(worst, std::min((at - kLow).abs().minCoeff(), (at - kHigh).abs().minCoeff()));
  }
  EXPECT_GT(worst, 0.1);
}

TEST_F(PointCloudTest, WhereNobodyKnowsThePoseThereIsNoPoint) {
  drive(101, 41, 70);  // 0.725 s
  scan(110);
  const Expected<CloudSize> size = measure_cloud(trajectory(), mount, open());
  ASSERT_TRUE(size.has_value() && write(*size).ok());
  const double start_s = 1e-6 * static_cast<double>(kStart_us);
  for (const Point& point : read_cloud(path(), false)) {
    const double since_s = point.time - start_s;
    ASSERT_TRUE(since_s < 40 * 0.025 + 1e-5 || since_s > 70 * 0.025 - 1e-5) << since_s;
  }
  EXPECT_LT(size->points, 72U * 1077U);
  scans.resize(20);
  EXPECT_EQ(write(*size).code(), StatusCode::kInternal) << "scans got lost";
}

TEST_F(PointCloudTest, NoScansGiveNoPoints) {
  drive(11);
  const Expected<CloudSize> size = measure_cloud(trajectory(), mount, open());
  ASSERT_TRUE(size.has_value());
  EXPECT_EQ(size->points, 0U);
}

}  // namespace
}  // namespace submapd
