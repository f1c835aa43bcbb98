// CARMEN text logs: known lines, damage at every place, and what is written reads back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>

#include "tests/unit/log/log_bytes.hpp"
#include "tools/log/carmen_reader.hpp"

namespace submapd::tools::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr double kDegree_rad = std::numbers::pi / 180.0;

const std::string kRobotLaser =
    "ROBOTLASER1 5 -2.094395 4.188790 0.006151 5.600 0.010 0 4 1.234 5.599 5.600 0.000 0 "
    "1.0 2.0 0.5 1.0 2.0 0.5 0 0 0 0 0 287.007421 urg04lx 287.107421\n";

TEST(CarmenTest, FlaserFieldsAreRead) {
  const auto log =
      read_bytes(flaser({"1.07", "49.99", "0.1234"}, "9 9 9 1.5 -2.5 0.25 976052857.1 exact 976052857.337284"));
  ASSERT_TRUE(log.status.ok()) << log.status.message();
  ASSERT_THAT(log.scans, SizeIs(1));
  const Scan& scan = log.scans[0];
  EXPECT_EQ(scan.stamp_us, 976052857337284);
  EXPECT_EQ(scan.index, 0U);
  EXPECT_THAT(scan.ranges_mm, ElementsAre(1070, 49990, 123));
  EXPECT_EQ(scan.odometry, (Pose2{1.5, -2.5, 0.25}));
  EXPECT_DOUBLE_EQ(scan.geometry.first_angle_rad, -90.0 * kDegree_rad);
  EXPECT_DOUBLE_EQ(scan.geometry.angle_step_rad, kDegree_rad);
  EXPECT_EQ(scan.geometry.sweep_s, 0.0);
  EXPECT_EQ(scan.geometry.range_min_m, 0.1);
  EXPECT_EQ(scan.geometry.range_max_m, 50.0);
  EXPECT_EQ(scan.geometry.base_from_sensor, Pose2{});
}

TEST(CarmenTest, FlaserStepFollowsTheNumberOfBeams) {
  const std::vector<std::pair<std::size_t, double>> steps_deg = {
      {1, 1.0}, {180, 1.0}, {181, 1.0}, {182, 0.5}, {360, 0.5}, {361, 0.5}, {362, 180.0 / 361.0}, {541, 1.0 / 3.0}};
  for (const auto& [beams, step_deg] : steps_deg) {
    const auto log = read_bytes(plain_flaser(beams));
    ASSERT_THAT(log.scans, SizeIs(1)) << beams;
    EXPECT_THAT(log.scans[0].ranges_mm, SizeIs(beams));
    EXPECT_DOUBLE_EQ(log.scans[0].geometry.angle_step_rad, step_deg * kDegree_rad) << beams;
  }
}

TEST(CarmenTest, WhatIsNoRangeBecomesNoReturn) {
  const auto log = read_bytes(
      flaser({"0", "0.000", "-1", "nan", "-nan", "inf", "1e999", "50", "50.00", "81.91", "49.999", "0.001", "1e-9"},
             "0 0 0 0 0 0 1 h 1"));
  ASSERT_THAT(log.scans, SizeIs(1));
  EXPECT_THAT(log.scans[0].ranges_mm, ElementsAre(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 49999, kErrorCode_mm, 0));
}

TEST(CarmenTest, RobotlaserFieldsAreRead) {
  const auto log = read_bytes(kRobotLaser);
  ASSERT_THAT(log.scans, SizeIs(1));
  const Scan& scan = log.scans[0];
  EXPECT_EQ(scan.stamp_us, 287107421);
  EXPECT_THAT(scan.ranges_mm, ElementsAre(1234, 5599, 0, 0));
  EXPECT_EQ(scan.odometry, (Pose2{1.0, 2.0, 0.5}));
  EXPECT_DOUBLE_EQ(scan.geometry.first_angle_rad, -2.094395);
  EXPECT_DOUBLE_EQ(scan.geometry.angle_step_rad, 0.006151);
  EXPECT_EQ(scan.geometry.range_min_m, 0.02);
  EXPECT_EQ(scan.geometry.range_max_m, 5.6);
  EXPECT_EQ(scan.geometry.base_from_sensor, Pose2{});
}

TEST(CarmenTest, RobotlaserLimitIsTheSensorsOrTheStorages) {
  const auto line = [](int type, double max_range_m) {
    return fmt::format(
        "ROBOTLASER1 {} -1.5 3.1 0.01 {} 0.01 0 4 29.9 51.14 65.535 65.6 2 7 8 0 0 0 0 0 0 0 0 0 0 0 1 h 1\n", type,
        max_range_m);
  };
  const auto log = read_bytes(line(5, 30.0) + line(5, 80.0) + line(0, 81.9));
  ASSERT_THAT(log.scans, SizeIs(3));
  EXPECT_THAT(log.scans[0].ranges_mm, ElementsAre(29900, 0, 0, 0));
  EXPECT_THAT(log.scans[1].ranges_mm, ElementsAre(29900, 51140, 0, 0));
  EXPECT_THAT(log.scans[2].ranges_mm, ElementsAre(29900, 0, 0, 0)) << "51.14 is a code of SICK scanners";
  EXPECT_EQ(log.scans[0].geometry.range_max_m, 30.0);
  EXPECT_EQ(log.scans[1].geometry.range_max_m, 65.535);
  EXPECT_EQ(log.scans[2].geometry.range_max_m, 50.0);
  EXPECT_EQ(log.scans[0].geometry.range_min_m, 0.1);
}

TEST(CarmenTest, LaserOffsetIsTheMountingAndDoesNotFlicker) {
  const auto line = [](double x, double y) {
    return fmt::format("ROBOTLASER1 5 -1 2 1 30 0 0 2 1 1 0 {:.6f} {:.6f} 1.570796 3.0 4.0 1.570796 0 0 0 0 0 1 h 1\n",
                       x, y);
  };
  const auto log = read_bytes(line(3.0, 4.2) + line(3.0, 4.200003) + line(3.0, 4.3));
  ASSERT_THAT(log.scans, SizeIs(3));
  EXPECT_NEAR(log.scans[0].geometry.base_from_sensor.x, 0.2, 1e-5);
  EXPECT_NEAR(log.scans[0].geometry.base_from_sensor.y, 0.0, 1e-5);
  EXPECT_EQ(log.scans[1].geometry, log.scans[0].geometry);
  EXPECT_NEAR(log.scans[2].geometry.base_from_sensor.x, 0.3, 1e-5);
}

TEST(CarmenTest, HeaderGivesTheSweep) {
  const auto log =
      read_bytes("# made by us\n" + plain_flaser(3) + "# sweep_s 0.01875\n" + plain_flaser(3) + kRobotLaser);
  ASSERT_THAT(log.scans, SizeIs(3));
  EXPECT_EQ(log.scans[0].geometry.sweep_s, 0.0);
  EXPECT_EQ(log.scans[1].geometry.sweep_s, 0.01875);
  EXPECT_EQ(log.scans[2].geometry.sweep_s, 0.01875);
  for (const char* bad : {"# sweep_s -1\n", "# sweep_s nan\n", "# sweep_s\n", "# sweep_s 1e9\n", "# sweep_s 0.1 s\n"}) {
    const auto damaged = read_bytes(bad + plain_flaser(3));
    ASSERT_THAT(damaged.scans, SizeIs(1)) << bad;
    EXPECT_EQ(damaged.scans[0].geometry.sweep_s, 0.0) << bad;
    EXPECT_EQ(damaged.summary.skipped_records, 1U) << bad;
  }
}

TEST(CarmenTest, RecordsAreCountedByKind) {
  const auto log = read_bytes("# comment\n\nPARAM robot_width 0.5 nohost 0\nNEFF 30\nODOM 0 0 0 0 0 0 1 odom 1\r\n" +
                              plain_flaser(2) + "ODOM 1e-05 0 0 0 0 0 2 odom 2\n" + kRobotLaser);
  EXPECT_EQ(log.summary.scans, 2U);
  EXPECT_EQ(log.summary.odometry_records, 2U);
  EXPECT_EQ(log.summary.other_records, 2U);
  EXPECT_EQ(log.summary.skipped_records, 0U) << log.summary.problems[0];
  EXPECT_FALSE(log.summary.unreadable_tail);
  EXPECT_EQ(log.scans[1].index, 1U);
}

TEST(CarmenTest, NonFiniteOdometryIsNone) {
  const auto log = read_bytes(flaser({"1"}, "0 0 0 nan 0 0 1 h 1"));
  ASSERT_THAT(log.scans, SizeIs(1));
  EXPECT_EQ(log.scans[0].odometry, std::nullopt);
}

TEST(CarmenTest, StampsThatRunBackwardsAreDeliveredAndCounted) {
  const auto log = read_bytes(plain_flaser(2, 5.0) + plain_flaser(2, 4.0) + plain_flaser(2, 4.0));
  ASSERT_THAT(log.scans, SizeIs(3));
  EXPECT_EQ(log.scans[1].stamp_us, 4000000);
  EXPECT_EQ(log.summary.backward_stamps, 1U);
}

TEST(CarmenTest, DamagedLinesAreSkippedAndTold) {
  const std::string tail = " 0 0 0 0 0 0 1 h 1\n";
  const std::vector<std::pair<std::string, std::string>> damages = {
      {"FLASER\n", "number of ranges"},
      {"FLASER x 1 2" + tail, "number of ranges is not a number: \"x\""},
      {"FLASER 0" + tail, "whole number from 1"},
      {"FLASER -3 1 1 1" + tail, "whole number from 1"},
      {"FLASER 2.5 1 1 1" + tail, "whole number from 1"},
      {"FLASER nan 1" + tail, "whole number from 1"},
      {"FLASER 10001 1 1 1" + tail, "whole number from 1"},
      {"FLASER 1000000000000 1 1 1" + tail, "whole number from 1"},
      {"FLASER 3 1 abc 1" + tail, "a range is not a number: \"abc\""},
      {"FLASER 3 1 1.2.3 1" + tail, "a range is not a number: \"1.2.3\""},
      {"FLASER 3 1 1,5 1" + tail, "a range is not a number: \"1,5\""},
      {"FLASER 4 1 1 1" + tail, "ipc_time is not a number: \"h\""},
      {"FLASER 2 1 1 1 0 0 0 0 0 0 1 7 1\n", "more fields"},
      {"FLASER 3 1 1 1 0 0 0\n", "ends before the odometry"},
      {"FLASER 3 1 1 1 0 0 0 0 0 0 1 h\n", "ends before logger_time"},
      {"FLASER 3 1 1 1 0 0 0 0 0 0 1 h nan\n", "logger_time is no time"},
      {"FLASER 3 1 1 1 0 0 0 0 0 0 1 h 1e300\n", "logger_time is no time"},
      {"FLASER 3 1 1 1 0 0 0 0 0 0 1 h 1 2\n", "more fields"},
      {"ROBOTLASER1 5 -1 2 0.1 -5 0 0 2 1 1 0" + tail, "max_range"},
      {"ROBOTLASER1 5 nan 2 0.1 5 0 0 2 1 1 0" + tail, "start_angle"},
      {"ROBOTLASER1 5 -1 2 99 5 0 0 2 1 1 0" + tail, "start_angle"},
      {"ROBOTLASER1 5 -1 2 0 5 0 0 2 1 1 0 0 0 0 0 0 0 0 0 0 0 0 1 h 1\n", "angular step is 0"},
      {"ROBOTLASER1 5 -1 2 0.1 5 0 0 2 1 1 20000 0 0 0 0 0 0 0 0 0 0 0 1 h 1\n", "number of remissions"},
      {"ROBOTLASER1 5 -1 2 0.1 5 0 0 2 1 1 3 0 0 0 0 0 0 0 0 0 0 0 1 h 1\n", "not a number: \"h\""},
      {"ODOM 1 2 3\n", "ends before"},
      {"ODOM 1 2 x 0 0 0 1 h 1\n", "not a number"},
      {std::string("\0\1\2\xFF junk\n", 10), "no keyword"},
      {std::string("FLASER 2 1 \0 1 0 0 0 0 0 0 1 h 1\n", 33), "a range is not a number: \"?\""},
  };
  for (const auto& [line, expected] : damages) {
    const auto log = read_bytes(plain_flaser(3) + line + plain_flaser(3));
    EXPECT_THAT(log.scans, SizeIs(2)) << line;
    EXPECT_EQ(log.summary.skipped_records, 1U) << line;
    EXPECT_EQ(log.summary.skipped_bytes, line.size()) << line;
    ASSERT_THAT(log.summary.problems, SizeIs(1)) << line;
    EXPECT_THAT(log.summary.problems[0], ::testing::StartsWith("line 2: ")) << line;
    EXPECT_THAT(log.summary.problems[0], HasSubstr(expected)) << line;
  }
}

TEST(CarmenTest, DamageAtEveryByteOfALineIsSurvived) {
  const std::string line = kRobotLaser;
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    std::string damaged = line;
    damaged[i] = '\x80';
    const auto log = read_bytes(plain_flaser(3) + damaged + plain_flaser(3));
    EXPECT_TRUE(log.status.ok());
    // Only the host is not interpreted.
    const bool in_host = i >= line.find("urg04lx") && i < line.find("urg04lx") + 7;
    EXPECT_EQ(log.summary.skipped_records, in_host ? 0U : 1U) << i;
  }
}

TEST(CarmenTest, OnlyTheFirstProblemsAreKept) {
  std::string text = plain_flaser(1);
  for (int i = 0; i < 100; ++i) text += "FLASER\n";
  const auto log = read_bytes(text);
  EXPECT_EQ(log.summary.skipped_records, 100U);
  EXPECT_THAT(log.summary.problems, SizeIs(LogSummary::kMaxProblems));
}

TEST(CarmenTest, LinesBeyondTheCapAreSkipped) {
  const std::string longest = "PARAM " + std::string(CarmenReader::kMaxLine_bytes - 7, 'x') + "\n";
  const std::string too_long = "PARAM " + std::string(3 * CarmenReader::kMaxLine_bytes, 'x') + "\n";
  const auto log = read_bytes(plain_flaser(3) + longest + too_long + plain_flaser(3));
  EXPECT_THAT(log.scans, SizeIs(2));
  EXPECT_EQ(log.summary.other_records, 1U);
  EXPECT_EQ(log.summary.skipped_records, 1U);
  EXPECT_EQ(log.summary.skipped_bytes, too_long.size());
  EXPECT_THAT(log.summary.problems[0], HasSubstr("line 3: is longer than"));
}

TEST(CarmenTest, TheLastLineMayLackItsLineFeed) {
  std::string text = plain_flaser(3) + plain_flaser(4);
  text.pop_back();
  EXPECT_THAT(read_bytes(text).scans, SizeIs(2));
}

TEST(CarmenTest, CutAnywhereNeverCostsMoreThanTheLastLine) {
  const std::string text = plain_flaser(3, 1.0) + plain_flaser(3, 2.0);
  const std::size_t first = plain_flaser(3).size();
  for (std::size_t size = first; size < text.size(); ++size) {
    const auto log = read_bytes(text.substr(0, size));
    ASSERT_TRUE(log.status.ok());
    EXPECT_GE(log.scans.size(), 1U);
    EXPECT_EQ(log.scans[0].stamp_us, 1000000);
  }
}

RC_GTEST_PROP(CarmenProperty, WhatIsWrittenReadsBack, ()) {
  const auto beams = *rc::gen::inRange<std::size_t>(1, 1100);
  const auto ranges_mm = *rc::gen::container<std::vector<std::uint16_t>>(
      beams, rc::gen::weightedOneOf<std::uint16_t>(
                 {{1, rc::gen::element<std::uint16_t>(0, 1)}, {9, rc::gen::inRange<std::uint16_t>(2, 30000)}}));
  const auto stamp_us = *rc::gen::inRange<std::int64_t>(0, 2'000'000'000'000'000);
  const auto odometry_um = *rc::gen::container<std::vector<int>>(3, rc::gen::inRange(-1'000'000'000, 1'000'000'000));
  const auto sweep_us = *rc::gen::inRange(0, 100'000);
  const bool is_flaser = *rc::gen::arbitrary<bool>();
  const bool is_packed = *rc::gen::arbitrary<bool>();

  std::string ranges;
  for (const auto range_mm : ranges_mm) ranges += fmt::format(" {}.{:03}", range_mm / 1000, range_mm % 1000);
  const Pose2 odometry{1e-6 * odometry_um[0], 1e-6 * odometry_um[1], 1e-6 * odometry_um[2]};
  const std::string pose = fmt::format("{:.6f} {:.6f} {:.6f}", odometry.x, odometry.y, odometry.yaw);
  const std::string stamp = fmt::format("{}.{:06}", stamp_us / 1000000, stamp_us % 1000000);
  const std::string front = is_flaser ? "FLASER" : "ROBOTLASER1 5 -2.5 5 0.004 30.0 0.01 0";
  const std::string poses = fmt::format("{}{} {}{}", is_flaser ? "" : "0 ", pose, pose, is_flaser ? "" : " 0 0 0 0 0");
  const std::string line = fmt::format("# sweep_s {}.{:06}\n{} {}{} {} {} host {}\n", sweep_us / 1000000,
                                       sweep_us % 1000000, front, beams, ranges, poses, stamp, stamp);

  const auto log = read_bytes(is_packed ? gzipped(line) : line);
  RC_ASSERT(log.status.ok());
  RC_ASSERT(log.scans.size() == 1U);
  RC_ASSERT(log.scans[0].ranges_mm == ranges_mm);
  RC_ASSERT(log.scans[0].stamp_us == stamp_us);
  RC_ASSERT(log.scans[0].odometry.has_value());
  RC_ASSERT(std::abs(log.scans[0].odometry->x - odometry.x) < 1e-9);
  RC_ASSERT(std::abs(log.scans[0].odometry->y - odometry.y) < 1e-9);
  RC_ASSERT(std::abs(log.scans[0].odometry->yaw - odometry.yaw) < 1e-9);
  RC_ASSERT(std::abs(log.scans[0].geometry.sweep_s - 1e-6 * sweep_us) < 1e-9);
  RC_ASSERT(log.scans[0].geometry.base_from_sensor == Pose2{});
  RC_ASSERT(log.summary.skipped_records == 0U);
}

}  // namespace
}  // namespace submapd::tools::test
