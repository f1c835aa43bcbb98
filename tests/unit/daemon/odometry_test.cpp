// Odometry from the network: what of it counts, and what a scan gets of it.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <limits>
#include <memory>

#include "daemon/odometry_input.hpp"
#include "daemon/scan_stamper.hpp"
#include "proto/lcm_message.hpp"
#include "slam/base/random.hpp"
#include "slam/submap/submap_check.hpp"
#include "submapd/odometry_t.hpp"
#include "submapd/trigger_t.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kWall_us = 1'600'000'000'000'000;  // when the monotonic clock is at 0
const Uuid kCart = Uuid::from_seed(1, 2);
const Twist2 kTwist{1.5, 0.0, 0.7};

std::vector<std::byte> message(std::int64_t utime_us, const Pose2& pose, const Uuid& cart = kCart) {
  odometry_t m{};
  m.utime = utime_us;
  put_uuid(cart, m.cart);
  put_pose(pose, m.odom_from_base);
  return encode_message(m);
}

class Sieve : public testing::Test {
 protected:
  // Measured and arrived, both monotonic.
  std::optional<OdometrySample> take(std::int64_t measured_ns, const Pose2& pose, std::int64_t arrived_ns,
                                     const Uuid& cart = kCart) {
    return sieve.take(message(kWall_us + measured_ns / 1000, pose, cart), arrived_ns, kWall_us + arrived_ns / 1000);
  }
  OdometrySieve sieve{kCart};
};

TEST_F(Sieve, AMeasurementIsAsOldAsItsStampSays) {
  const auto sample = take(1'000 * kMs, {1.0, 2.0, 0.5}, 1'007 * kMs);
  ASSERT_TRUE(sample.has_value());
  EXPECT_EQ(sample->mono_ns, 1'000 * kMs);
  EXPECT_EQ(sample->odom_from_base, (Pose2{1.0, 2.0, 0.5}));
  // The system's clock is set an hour back: stamps and clock of the next message agree again.
  const auto later = sieve.take(message(kWall_us - 3'600'000'000 + 1'020'000, {1.0, 2.0, 0.5}), 1'025 * kMs,
                                kWall_us - 3'600'000'000 + 1'025'000);
  ASSERT_TRUE(later.has_value());
  EXPECT_EQ(later->mono_ns, 1'020 * kMs);
  const auto unstamped = sieve.take(message(0, {}, Uuid{}), 1'500 * kMs, kWall_us);
  ASSERT_TRUE(unstamped.has_value()) << "whose cart need not be said";
  EXPECT_EQ(unstamped->mono_ns, 1'500 * kMs);
  EXPECT_EQ(sieve.counters().taken, 3U);
}

TEST_F(Sieve, WhatCannotBeIsCountedAndLeftOut) {
  ASSERT_TRUE(take(1'000 * kMs, {}, 1'001 * kMs));
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e7}) {
    EXPECT_FALSE(take(1'010 * kMs, {bad, 0.0, 0.0}, 1'010 * kMs));
    EXPECT_FALSE(take(1'010 * kMs, {0.0, -bad, 0.0}, 1'010 * kMs));
    EXPECT_FALSE(take(1'010 * kMs, {0.0, 0.0, bad}, 1'010 * kMs));
  }
  EXPECT_FALSE(sieve.take(message(-1, {}), 1'010 * kMs, kWall_us));
  EXPECT_FALSE(sieve.take(encode_message(trigger_t{}), 1'010 * kMs, kWall_us));
  EXPECT_EQ(sieve.counters().bad, 11U);
  EXPECT_FALSE(take(1'010 * kMs, {}, 1'010 * kMs, Uuid::from_seed(9, 9)));
  EXPECT_EQ(sieve.counters().foreign, 1U);
  EXPECT_FALSE(take(1'010 * kMs, {}, 1'511 * kMs));
  EXPECT_FALSE(take(1'031 * kMs, {}, 1'010 * kMs)) << "from the future";
  EXPECT_FALSE(sieve.take(message(std::numeric_limits<std::int64_t>::max(), {}), 1'010 * kMs, kWall_us));
  EXPECT_EQ(sieve.counters().stale, 3U);
  EXPECT_FALSE(take(1'000 * kMs, {}, 1'010 * kMs)) << "said again";
  EXPECT_FALSE(take(990 * kMs, {}, 1'010 * kMs)) << "out of order";
  EXPECT_EQ(sieve.counters().crowded, 2U);
  EXPECT_TRUE(take(1'010 * kMs, {}, 1'010 * kMs)) << "none of them spoils the next";
  EXPECT_EQ(sieve.counters().taken, 2U);
}

TEST_F(Sieve, AFloodIsThinnedOut) {
  for (int i = 0; i < 20'000; ++i) {
    const std::int64_t now_ns = 1'000 * kMs + i * kMs / 20;
    (void)take(now_ns, {}, now_ns);
  }
  EXPECT_LE(sieve.counters().taken, 1'000U);
  EXPECT_EQ(sieve.counters().taken + sieve.counters().crowded, 20'000U);
}

TEST_F(Sieve, EveryCutIsRefused) {
  std::vector<std::byte> whole = message(kWall_us, {});
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_FALSE(sieve.take(std::span(whole).first(size), 0, kWall_us)) << size;
  }
  EXPECT_TRUE(sieve.take(whole, 0, kWall_us));
  whole.push_back(std::byte{0});
  EXPECT_FALSE(sieve.take(whole, 10 * kMs, kWall_us));
}

// Samples of a constant twist every 20 ms.
class Track : public testing::Test {
 protected:
  static Pose2 truth(std::int64_t ns) { return exp_twist(kTwist, static_cast<double>(ns) * 1e-9); }
  void say(std::int64_t mono_ns, const Pose2& pose, std::uint32_t stretch = 1) {
    OdometrySample* const slot = ring.claim();
    ASSERT_NE(slot, nullptr);
    *slot = {mono_ns, pose, stretch};
    ring.publish();
  }
  void say_until(std::int64_t from_ns, std::int64_t to_ns) {
    for (std::int64_t t = from_ns; t <= to_ns; t += 20 * kMs) say(t, truth(t));
  }
  OdometryRing ring{256};
  OdometryTrack track{ring};
};

void expect_near(const std::optional<Pose2>& pose, const Pose2& expected) {
  ASSERT_TRUE(pose.has_value());
  EXPECT_NEAR(pose->x, expected.x, 1e-9);
  EXPECT_NEAR(pose->y, expected.y, 1e-9);
  EXPECT_NEAR(pose->yaw, expected.yaw, 1e-9);
}

TEST_F(Track, BetweenSamplesAndALittleBeyondItFollowsTheTwist) {
  EXPECT_FALSE(track.pose_at(0).has_value()) << "nothing is known";
  say_until(0, 100 * kMs);
  EXPECT_FALSE(track.pose_at(1 * kMs).has_value()) << "the first says in which frame";
  expect_near(track.pose_at(33 * kMs), truth(33 * kMs));
  expect_near(track.pose_at(40 * kMs), truth(40 * kMs));
  expect_near(track.pose_at(100 * kMs), truth(100 * kMs));
  expect_near(track.pose_at(150 * kMs), truth(150 * kMs));
  EXPECT_FALSE(track.pose_at(151 * kMs).has_value()) << "too far beyond the newest";
  EXPECT_FALSE(track.pose_at(-1).has_value()) << "before the oldest";
  EXPECT_EQ(track.joined(), 4U);
}

TEST_F(Track, AcrossAGapNothingIsInvented) {
  say_until(0, 40 * kMs);
  (void)track.pose_at(0);
  say_until(300 * kMs, 340 * kMs);
  EXPECT_FALSE(track.pose_at(200 * kMs).has_value());
  expect_near(track.pose_at(310 * kMs), truth(310 * kMs));
}

TEST_F(Track, AfterAJumpOneScanGoesWithout) {
  say_until(0, 100 * kMs);
  (void)track.pose_at(0);
  expect_near(track.pose_at(90 * kMs), truth(90 * kMs));
  for (std::int64_t t = 120 * kMs; t <= 200 * kMs; t += 20 * kMs) say(t, {50.0, 0.0, 0.0}, 2);
  EXPECT_FALSE(track.pose_at(110 * kMs).has_value()) << "between the two frames";
  EXPECT_FALSE(track.pose_at(135 * kMs).has_value());
  expect_near(track.pose_at(160 * kMs), {50.0, 0.0, 0.0});
}

TEST_F(Track, ATurnThroughHalfACircleIsNoTurnBack) {
  for (int i = 0; i < 10; ++i) {
    const double yaw = wrap_angle(std::numbers::pi - 0.1 + 0.03 * i);
    say(i * 20 * kMs, {0.0, 0.0, yaw});
  }
  (void)track.pose_at(0);
  for (std::int64_t t = 20 * kMs; t < 180 * kMs; t += 7 * kMs) {
    const std::optional<Pose2> pose = track.pose_at(t);
    ASSERT_TRUE(pose.has_value());
    EXPECT_NEAR(wrap_angle(pose->yaw - (std::numbers::pi - 0.1 + 0.0015 * static_cast<double>(t / kMs))), 0.0, 1e-9);
  }
}

// Whatever the sieve lets through, a scan's odometry is one that the raw log can give back.
RC_GTEST_PROP(OdometryProperty, WhatIsJoinedIsSoundAndMovesLikeACart, (std::uint64_t seed)) {
  CounterRandom random(seed, 1, 0);
  OdometrySieve sieve(kCart);
  OdometryRing ring(256);
  OdometryTrack track(ring);
  std::int64_t now_ns = 1'000 * kMs;
  Pose2 pose;
  std::optional<Pose2> before;
  std::int64_t before_ns = 0;
  std::int64_t scan_ns = now_ns;
  for (int i = 0; i < 400; ++i) {
    now_ns += static_cast<std::int64_t>(random.uniform() * 30.0 * static_cast<double>(kMs));
    if (random.uniform() < 0.1)
      pose = {random.uniform(-1e6, 1e6), random.uniform(-1e6, 1e6), random.uniform(-9.0, 9.0)};
    pose = compose(pose, {random.uniform(-0.05, 0.05), 0.0, random.uniform(-0.05, 0.05)});
    const std::int64_t utime_us = kWall_us + now_ns / 1000 - static_cast<std::int64_t>(random.uniform() * 20'000.0);
    if (const auto sample = sieve.take(message(utime_us, pose), now_ns, kWall_us + now_ns / 1000)) {
      if (OdometrySample* const slot = ring.claim()) {
        *slot = *sample;
        ring.publish();
      }
    }
    if (now_ns < scan_ns + 27 * kMs) continue;
    const std::optional<Pose2> joined = track.pose_at(scan_ns);
    if (joined) {
      RC_ASSERT(is_sound(*joined));
      if (before) {
        const Pose2 moved = between(*before, *joined);
        const double seconds = static_cast<double>(scan_ns - before_ns) * 1e-9;
        RC_ASSERT(std::hypot(moved.x, moved.y) < 6.0 * seconds + 0.051);
      }
    }
    before = joined;
    before_ns = scan_ns;
    scan_ns += 25 * kMs;
  }
}

TEST(StampedOdometry, TheRingsOdometryIsTheScans) {
  auto measured = std::make_unique<driver::DeviceScan>();
  ScanStamper stamper(RunClock(0), utm30lx_geometry());
  measured->odometry = {1.0, 2.0, 3.0};
  EXPECT_FALSE(stamper.stamp(*measured).odometry.has_value());
  measured->flags = driver::kScanHasOdometry;
  EXPECT_EQ(stamper.stamp(*measured).odometry, (Pose2{1.0, 2.0, 3.0}));
  measured->flags = 0;
  EXPECT_FALSE(stamper.stamp(*measured).odometry.has_value()) << "the last one's is not this one's";
}

}  // namespace
}  // namespace submapd
