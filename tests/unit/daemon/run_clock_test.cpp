// The run's clock never steps back over what the run has, and a clock that is set is noticed.
#include "daemon/run_clock.hpp"

#include <gtest/gtest.h>

#include "daemon/clock_watch.hpp"

namespace submapd {
namespace {

TEST(RunClockTest, AfterAnInstantOfTheRunItIsNeverBeforeIt) {
  const std::int64_t now_us = RunClock::now().utime_us();
  EXPECT_GE(RunClock::now_after(now_us + 3'600'000'000).utime_us(), now_us + 3'600'000'000)
      << "the system lost its time";
  const std::int64_t later_us = RunClock::now_after(now_us - 3'600'000'000).utime_us();
  EXPECT_GE(later_us, now_us);
  EXPECT_LT(later_us, now_us + 600'000'000) << "the system's clock is right";
}

TEST(RunClockTest, OfALogItIsTheNewestScan) {
  const auto now_ns = std::make_shared<std::atomic<std::int64_t>>(5'000'000);
  const RunClock clock(now_ns);
  EXPECT_TRUE(clock.is_virtual());
  EXPECT_EQ(clock.utime_us(), 5000);
  now_ns->store(6'000'000);
  EXPECT_EQ(clock.utime_us(), 6000);
  EXPECT_EQ(clock.utime_us(7'000'000), 7000);
}

TEST(ClockWatchTest, StepsAreToldOnceAndSlewingIsNot) {
  ClockWatch watch(1'000);
  EXPECT_EQ(watch.look(1'000), std::nullopt);
  EXPECT_EQ(watch.look(100'000'000), std::nullopt);
  EXPECT_EQ(watch.look(-3'600'000'000'000 + 100'000'000), -3'600'000'000'000);
  EXPECT_EQ(watch.look(-3'600'000'000'000 + 100'000'000), std::nullopt);
  EXPECT_EQ(watch.look(100'000'000), 3'600'000'000'000);
}

}  // namespace
}  // namespace submapd
