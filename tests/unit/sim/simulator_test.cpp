// Scans are measured beam by beam at their own times, noise has its documented size, and a seed fixes every byte.
#include "tools/sim/simulator.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iterator>
#include <sstream>

#include "tools/sim/floor_plan.hpp"
#include "tools/sim/office.hpp"
#include "tools/sim/scan_sink.hpp"

namespace submapd::tools {
namespace {

std::shared_ptr<const Motion> straight_ahead(double duration_s) {
  Route route;
  route.waypoints = {{0.0, 0.0}, {20.0, 0.0}};
  MotionOptions options;
  options.duration_s = duration_s;
  options.speed_m_s = 3.0;
  Expected<Motion> motion = Motion::along(route, options);
  return std::make_shared<const Motion>(std::move(*motion));
}

std::shared_ptr<const Motion> in_office(std::uint64_t seed, double duration_s) {
  MotionOptions options;
  options.seed = seed;
  options.duration_s = duration_s;
  options.speed_m_s = 3.0;
  Expected<Motion> motion = Motion::along(office_tour(), options);
  return std::make_shared<const Motion>(std::move(*motion));
}

// A wall ahead and one on the left seen from a moving, slightly wobbling cart: each beam has a closed form at its time.
TEST(Simulator, BeamsAreCastFromThePoseAtTheirOwnTime) {
  constexpr double kAhead_m = 25.0;
  constexpr double kLeft_m = 2.0;
  const auto world = std::make_shared<const World>(
      std::vector<Segment>{{{kAhead_m, -200.0}, {kAhead_m, 200.0}}, {{-200.0, kLeft_m}, {200.0, kLeft_m}}});
  const auto motion = straight_ahead(9.0);
  SimulatorOptions options;
  options.sensor.noise = false;
  Simulator simulator(world, motion, options);
  double largest_shift_m = 0.0;
  while (const std::optional<Scan> scan = simulator.next()) {
    const double start_s = static_cast<double>(scan->index) * 0.025;
    ASSERT_EQ(scan->ranges_mm.size(), 1081U);
    for (int i = 0; i < 1081; ++i) {
      const double time_s = start_s + i / 1080.0 * 0.01875;
      const auto range_at = [&](double t) {
        const Pose2 pose = motion->at(t);
        const double yaw = pose.yaw + (-135.0 + 0.25 * i) * std::numbers::pi / 180.0;
        double range = 1e9;
        if (std::cos(yaw) > 0.0) {
          range = (kAhead_m - pose.x) / std::cos(yaw);
        }
        if (std::sin(yaw) > 0.0) {
          range = std::min(range, (kLeft_m - pose.y) / std::sin(yaw));
        }
        return range;
      };
      const double expected_m = range_at(time_s);
      const std::uint16_t range_mm = scan->ranges_mm[static_cast<std::size_t>(i)];
      if (std::abs(expected_m - 30.0) < 1e-6) {
        continue;
      }
      if (expected_m > 30.0) {
        ASSERT_EQ(range_mm, kNoReturn_mm) << "scan " << scan->index << " beam " << i;
      } else {
        ASSERT_NEAR(range_mm, 1000.0 * expected_m, 0.5 + 1e-6) << "scan " << scan->index << " beam " << i;
        largest_shift_m = std::max(largest_shift_m, std::abs(expected_m - range_at(start_s)));
      }
    }
  }
  EXPECT_GT(largest_shift_m, 0.02) << "the test must be able to tell the beam's time from the scan's";
}

TEST(Simulator, TruthIsTheMotionAtTheStampOfTheFirstBeam) {
  const auto world = std::make_shared<const World>(office_world());
  const auto motion = in_office(1, 10.0);
  Simulator simulator(world, motion, {});
  EXPECT_EQ(simulator.scan_count(), 400U);  // the last sweep ends 6.25 ms before the end
  std::uint64_t count = 0;
  while (const std::optional<Scan> scan = simulator.next()) {
    EXPECT_EQ(scan->index, count);
    EXPECT_EQ(scan->stamp_us, 1'700'000'000'000'000 + static_cast<std::int64_t>(count) * 25'000);
    const Pose2 difference = between(motion->at(static_cast<double>(count) * 0.025), simulator.truth(*scan));
    EXPECT_LT(difference.translation().norm(), 1e-9);
    EXPECT_NEAR(difference.yaw, 0.0, 1e-9);
    EXPECT_FALSE(scan->odometry);
    ++count;
  }
  EXPECT_EQ(count, simulator.scan_count());
}

TEST(Simulator, NoiseAndMissingReturnsHaveTheirDocumentedSize) {
  // Standing before a wall met head on, 5 m and 25 m away.
  for (const auto& [distance_m, sigma_m, missing] :
       {std::tuple{5.0, 0.010, 0.001 + 0.02 / 36.0}, std::tuple{25.0, 0.025, 0.001 + 0.02 * 25.0 / 36.0}}) {
    const auto world = std::make_shared<const World>(std::vector<Segment>{{{distance_m, -100.0}, {distance_m, 100.0}}});
    Route route;
    route.waypoints = {{0.0, 0.0}, {1.0, 0.0}};
    MotionOptions motion_options;
    motion_options.standstill_s = 100.0;
    const auto motion = std::make_shared<const Motion>(*Motion::along(route, motion_options));
    SimulatorOptions options;
    options.sensor.bias_m = 0.05;
    Simulator simulator(world, motion, options);
    double sum = 0.0;
    double squares = 0.0;
    int hits = 0;
    int beams = 0;
    for (int scan_number = 0; scan_number < 3900; ++scan_number) {
      const std::optional<Scan> scan = simulator.next();
      for (int i = 530; i <= 550; ++i) {
        const double range_m = 1e-3 * scan->ranges_mm[static_cast<std::size_t>(i)];
        ++beams;
        if (range_m > 0.0) {
          const double error_m = range_m - distance_m / std::cos((i - 540) * std::numbers::pi / 720.0);
          sum += error_m;
          squares += error_m * error_m;
          ++hits;
        }
      }
    }
    const double mean = sum / hits;
    EXPECT_NEAR(mean, 0.05, 0.001) << distance_m;
    EXPECT_NEAR(std::sqrt(squares / hits - mean * mean), sigma_m, 0.05 * sigma_m) << distance_m;
    EXPECT_NEAR(1.0 - static_cast<double>(hits) / beams, missing, 0.2 * missing) << distance_m;
  }
}

TEST(Simulator, OdometryDriftsButFollowsTheMotion) {
  const auto world = std::make_shared<const World>(office_world());
  const auto motion = in_office(3, 30.0);
  SimulatorOptions options;
  options.odometry = OdometryOptions{};
  Simulator simulator(world, motion, options);
  Pose2 last_odometry;
  Pose2 last_truth = motion->at(0.0);
  double worst_step_m = 0.0;
  while (const std::optional<Scan> scan = simulator.next()) {
    ASSERT_TRUE(scan->odometry);
    const Pose2 truth = simulator.truth(*scan);
    const Pose2 error = between(between(last_truth, truth), between(last_odometry, *scan->odometry));
    worst_step_m = std::max(worst_step_m, error.translation().norm());
    if (scan->index < 40) {
      EXPECT_EQ(*scan->odometry, Pose2{}) << "a standing cart's wheels do not turn";
    }
    last_truth = truth;
    last_odometry = *scan->odometry;
  }
  EXPECT_LT(worst_step_m, 0.03);
  const Pose2 end = between(between(motion->at(0.0), last_truth), last_odometry);
  EXPECT_GT(end.translation().norm(), 0.02);
  EXPECT_LT(end.translation().norm(), 5.0);
}

class SinkTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("submapd_sim_" + std::to_string(reinterpret_cast<std::uintptr_t>(this)) + "_" +
               std::to_string(::testing::UnitTest::GetInstance()->random_seed()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  void record(const std::string& name, std::uint64_t seed) {
    const auto world = std::make_shared<const World>(office_world());
    SimulatorOptions options;
    options.seed = seed;
    options.odometry = OdometryOptions{};
    Simulator simulator(world, in_office(seed, 5.0), options);
    auto log = open_clf_sink(path(name));
    auto truth = open_truth_sink(path(name + ".tum"));
    ASSERT_TRUE(log && truth);
    while (const std::optional<Scan> scan = simulator.next()) {
      ASSERT_TRUE((*log)->write(*scan, simulator.truth(*scan)).ok());
      ASSERT_TRUE((*truth)->write(*scan, simulator.truth(*scan)).ok());
    }
    ASSERT_TRUE((*log)->finish().ok());
    ASSERT_TRUE((*truth)->finish().ok());
  }

  std::filesystem::path folder_;
};

TEST_F(SinkTest, SameSeedSameBytesOtherSeedOtherBytes) {
  record("a.clf", 7);
  record("b.clf", 7);
  record("c.clf", 8);
  record("d.clf.gz", 7);
  const std::string a = *read_text_file(path("a.clf"));
  EXPECT_TRUE(a == *read_text_file(path("b.clf")));
  EXPECT_TRUE(*read_text_file(path("a.clf.tum")) == *read_text_file(path("b.clf.tum")));
  EXPECT_FALSE(a == *read_text_file(path("c.clf")));
  EXPECT_FALSE(*read_text_file(path("a.clf.tum")) == *read_text_file(path("c.clf.tum")));
  EXPECT_TRUE(a == *read_text_file(path("d.clf.gz"))) << "compression must not change the log";
  EXPECT_LT(std::filesystem::file_size(path("d.clf.gz")), a.size() / 2);
}

TEST_F(SinkTest, LineHasTheDocumentedFields) {
  Scan scan;
  scan.stamp_us = 1'700'000'000'025'000;
  scan.geometry = utm30lx_geometry();
  scan.ranges_mm.assign(1081, 0);
  scan.ranges_mm[0] = 1234;
  scan.ranges_mm[1] = 30000;
  scan.ranges_mm[1080] = 7;
  scan.odometry = Pose2{1.5, -2.25, 0.5};
  auto log = open_clf_sink(path("line.clf"));
  ASSERT_TRUE(log);
  ASSERT_TRUE((*log)->write(scan, {}).ok());
  EXPECT_FALSE(std::filesystem::exists(path("line.clf"))) << "no file before it is whole";
  ASSERT_TRUE((*log)->finish().ok());
  std::istringstream text(*read_text_file(path("line.clf")));
  std::string line;
  bool has_sweep = false;
  while (std::getline(text, line) && line.starts_with("#")) {
    has_sweep = has_sweep || line == "# sweep_s 0.01875";
  }
  EXPECT_TRUE(has_sweep);
  std::istringstream words(line);
  const std::vector<std::string> field(std::istream_iterator<std::string>{words}, {});
  ASSERT_EQ(field.size(), 9U + 1081U + 1U + 6U + 5U + 3U);
  EXPECT_EQ(field[0], "ROBOTLASER1");
  const double step = std::stod(field[4]);
  EXPECT_NEAR(std::stod(field[2]), -0.75 * std::numbers::pi, 1e-12);
  EXPECT_NEAR(std::stod(field[2]) + 1080 * step, 0.75 * std::numbers::pi, 1e-9);
  EXPECT_NEAR(std::stod(field[3]), 1080 * step, 1e-9);
  EXPECT_EQ(field[5], "30.000");
  EXPECT_EQ(field[8], "1081");
  EXPECT_EQ(field[9], "1.234");
  EXPECT_EQ(field[10], "30.000");
  EXPECT_EQ(field[11], "0.000");
  EXPECT_EQ(field[9 + 1080], "0.007");
  const std::vector<std::string> tail(field.begin() + 9 + 1081, field.end());
  EXPECT_THAT(tail, testing::ElementsAre("0", "1.500000", "-2.250000", "0.500000", "1.500000", "-2.250000", "0.500000",
                                         "0", "0", "0", "0", "0", "1700000000.025000", "sim", "1700000000.025000"));
}

TEST_F(SinkTest, TruthLineHasTheStampAndAUnitQuaternion) {
  Scan scan;
  scan.stamp_us = 1'700'000'000'000'007;
  auto truth = open_truth_sink(path("truth.tum"));
  ASSERT_TRUE(truth);
  ASSERT_TRUE((*truth)->write(scan, {1.0, -2.5, -2.0}).ok());
  ASSERT_TRUE((*truth)->finish().ok());
  std::istringstream words(*read_text_file(path("truth.tum")));
  const std::vector<std::string> field(std::istream_iterator<std::string>{words}, {});
  ASSERT_EQ(field.size(), 8U);
  EXPECT_EQ(field[0], "1700000000.000007");
  EXPECT_EQ(field[1], "1.000000000");
  EXPECT_EQ(field[2], "-2.500000000");
  EXPECT_NEAR(2.0 * std::atan2(std::stod(field[6]), std::stod(field[7])), -2.0, 1e-9);
}

TEST_F(SinkTest, UnfinishedFilesVanishAndUnopenableOnesAreReported) {
  { ASSERT_TRUE(open_clf_sink(path("half.clf"))); }
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
  const auto nowhere = open_clf_sink(path("no/such/folder/a.clf"));
  ASSERT_FALSE(nowhere);
  EXPECT_EQ(nowhere.error().code(), StatusCode::kIo);
  EXPECT_THAT(nowhere.error().message(), testing::HasSubstr("no/such/folder/a.clf"));
}

}  // namespace
}  // namespace submapd::tools
