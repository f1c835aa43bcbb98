#include "proto/scan_conversion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <limits>
#include <span>
#include <vector>

#include "proto/lcm_message.hpp"
#include "slam/submap/submap_check.hpp"
#include "submapd/pose_t.hpp"
#include "submapd/scan_t.hpp"

namespace submapd {
namespace {

Scan scan_of(std::size_t beams) {
  Scan scan;
  scan.stamp_us = 1'600'000'000'000'000;
  scan.index = 42;
  for (std::size_t i = 0; i < beams; ++i) scan.ranges_mm.push_back(static_cast<std::uint16_t>(i * 61));
  return scan;
}

void put_i32(std::vector<std::byte>& bytes, std::size_t offset, std::int32_t value) {
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[offset + i] = static_cast<std::byte>((static_cast<std::uint32_t>(value) >> (24 - 8 * i)) & 0xFF);
  }
}

RC_GTEST_PROP(ScanConversion, ComesBackAsItWas, (std::int64_t stamp_us, bool odometry, std::uint64_t seed)) {
  Scan scan;
  scan.stamp_us = stamp_us;
  scan.index = seed >> 1;
  scan.geometry.sweep_s = static_cast<double>(*rc::gen::inRange(0, 100)) / 1000.0;
  scan.geometry.base_from_sensor = {static_cast<double>(*rc::gen::inRange(-9, 9)), 0.5, -0.25};
  scan.ranges_mm = *rc::gen::container<std::vector<std::uint16_t>>(rc::gen::arbitrary<std::uint16_t>());
  if (odometry) scan.odometry = Pose2{1.0, -2.0, static_cast<double>(*rc::gen::inRange(-3, 3))};
  const ScanOrigin origin{Uuid::from_seed(seed, 1), Uuid::from_seed(seed, 2), *rc::gen::arbitrary<std::int64_t>(),
                          *rc::gen::arbitrary<std::int64_t>()};
  const Expected<ScanMessage> decoded = decode_scan(encode_scan(scan, origin));
  RC_ASSERT(decoded.has_value());
  RC_ASSERT(decoded->origin == origin);
  RC_ASSERT(decoded->scan.stamp_us == scan.stamp_us);
  RC_ASSERT(decoded->scan.index == scan.index);
  RC_ASSERT(decoded->scan.geometry == scan.geometry);
  RC_ASSERT(decoded->scan.ranges_mm == scan.ranges_mm);
  RC_ASSERT(decoded->scan.odometry == scan.odometry);
}

TEST(ScanConversion, AFullScanFitsADatagramEasily) {
  EXPECT_LT(encode_scan(scan_of(1081), {}).size(), 2600U);
  EXPECT_TRUE(decode_scan(encode_scan(scan_of(kMaxBeams), {})).has_value());
  EXPECT_FALSE(decode_scan(encode_scan(scan_of(kMaxBeams + 1), {})).has_value());
}

TEST(ScanConversion, EveryCutIsRefused) {
  std::vector<std::byte> bytes = encode_scan(scan_of(10), {});
  const std::size_t whole = bytes.size();
  bytes.push_back(std::byte{0});
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    EXPECT_EQ(decode_scan(std::span(bytes).first(size)).has_value(), size == whole) << size;
  }
}

// The generated decoder alone would resize() its vector to this.
TEST(ScanConversion, AbsurdArrayLengthsAreRefusedBeforeAllocation) {
  std::vector<std::byte> bytes = encode_scan(scan_of(10), {});
  const std::size_t count_offset = bytes.size() - 2 * 10 - 4;
  for (const std::int32_t count :
       {9, 11, -1, 1 << 30, std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::min()}) {
    put_i32(bytes, count_offset, count);
    const Expected<ScanMessage> decoded = decode_scan(bytes);
    ASSERT_FALSE(decoded.has_value()) << count;
    EXPECT_EQ(decoded.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(decoded.error().message(), testing::HasSubstr("array length"));
  }
  put_i32(bytes, count_offset, 10);
  EXPECT_TRUE(decode_scan(bytes).has_value());
}

TEST(ScanConversion, OtherTypesAndIllegalValuesAreRefused) {
  std::vector<std::byte> bytes = encode_scan(scan_of(3), {});
  bytes[0] ^= std::byte{1};  // fingerprint
  EXPECT_FALSE(decode_scan(bytes).has_value());

  const auto refused = [](auto change) {
    scan_t message{};
    message.range_max_m = 30.0;
    EXPECT_TRUE(decode_scan(encode_message(message)).has_value());
    change(message);
    return !decode_scan(encode_message(message)).has_value();
  };
  EXPECT_TRUE(refused([](scan_t& m) { m.seq = -1; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.has_odometry = 2; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.odometry[1] = std::numeric_limits<double>::quiet_NaN(); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.radstep = std::numeric_limits<double>::infinity(); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.sweep_s = -1.0; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.base_from_sensor[2] = 1e300; }));
}

TEST(LcmMessage, FixedSizeTypesNeedTheirSize) {
  pose_t pose{};
  pose.particles = 30;
  std::vector<std::byte> bytes = encode_message(pose);
  ASSERT_TRUE(decode_message<pose_t>(bytes).has_value());
  EXPECT_EQ(decode_message<pose_t>(bytes)->particles, 30);
  bytes.push_back(std::byte{0});
  EXPECT_FALSE(decode_message<pose_t>(bytes).has_value());
}

TEST(LcmMessage, HealthWithAnAbsurdTextLengthIsRefused) {
  health_t health{};
  health.message = "no multicast route";
  std::vector<std::byte> bytes = encode_message(health);
  ASSERT_TRUE(decode_health(bytes).has_value());
  EXPECT_EQ(decode_health(bytes)->message, health.message);
  const std::size_t count_offset = bytes.size() - health.message.size() - 1 - 4;
  for (const std::int32_t count : {0, -1, 5, 1 << 30, std::numeric_limits<std::int32_t>::min()}) {
    put_i32(bytes, count_offset, count);
    EXPECT_FALSE(decode_health(bytes).has_value()) << count;
  }
  EXPECT_FALSE(decode_health({}).has_value());
  EXPECT_TRUE(decode_health(encode_message(health_t{})).has_value());
}

}  // namespace
}  // namespace submapd
