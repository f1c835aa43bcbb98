// The sensor clock against simulated crystals: the truth is inside the stated bound for every scan, and the estimate is
// much better than the bound.
#include "driver/clock/sensor_clock.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "driver/clock/usb_grid.hpp"
#include "tests/unit/driver/clock/sensor_sim.hpp"

namespace submapd::driver::test {
namespace {

constexpr double kMinute_us = 60e6;

// Root mean square and worst.
class Errors {
 public:
  void add(double us) {
    squares_ += us * us;
    ++count_;
  }
  [[nodiscard]] double rms_us() const { return count_ == 0 ? 0.0 : std::sqrt(squares_ / count_); }

 private:
  double squares_ = 0.0;
  double count_ = 0.0;
};

struct Ride {
  double late_us = 0.0;  // how long the host takes now to see what came
  explicit Ride(const SimOptions& options, std::uint32_t seed = 1)
      : sim(options, seed), clock(clock_options(options)) {}

  static ClockOptions clock_options(const SimOptions& options) {
    ClockOptions result;
    result.usb_grid_us = options.grid_us;
    result.stamp_to_first_beam_us = options.stamp_to_first_beam_us;
    return result;
  }

  void synchronise(int replies) {
    for (int i = 0; i < replies; ++i) {
      const SensorSim::Reply reply = sim.ask_time();
      clock.add_time_reply(reply.sent_ns, reply.received_ns, reply.device_ms);
      sim.rest(sim.uniform(0.0, 38e3));
    }
  }

  // One scan; its error is in error_us.
  ScanTime scan() {
    const SensorSim::Scan scan = sim.next_scan();
    const ScanTime time = clock.add_scan(scan.device_ms, scan.first_byte_ns + static_cast<std::int64_t>(1e3 * late_us));
    error_us = static_cast<double>(time.first_beam_mono_ns) / 1e3 - scan.first_beam_us;
    outside += std::abs(error_us) > static_cast<double>(time.error_bound_ns) / 1e3 ? 1 : 0;
    return time;
  }

  void scan_for(double us) {
    for (const double end_us = sim.now_us() + us; sim.now_us() < end_us;) {
      const ScanTime time = scan();
      lost += time.lost_before;
      repeated += time.repeated ? 1 : 0;
    }
  }

  [[nodiscard]] double skew_error_ppm() const { return clock.skew_ppm().middle() - sim.true_skew_ppm(sim.now_us()); }

  SensorSim sim;
  SensorClock clock;
  double error_us = 0.0;
  int outside = 0;  // scans whose truth was outside the bound
  std::uint64_t lost = 0;
  std::uint64_t repeated = 0;
};

struct Figures {
  Errors first_minute;
  Errors last_minute;
  Errors all;
  int outside = 0;
  double worst_skew_ppm = 0.0;
  std::uint64_t contradictions = 0;
};

// Eleven minutes, twelve seeds: synchronised for three seconds, then scans, with twenty TM1 at a stop once a minute if
// `stops`.
Figures measure(SimOptions options, bool stops) {
  Figures figures;
  for (std::uint32_t seed = 1; seed <= 12; ++seed) {
    Ride run(options, seed);
    run.synchronise(150);
    for (int minute = 0; minute < 11; ++minute) {
      for (const double end_us = run.sim.now_us() + kMinute_us; run.sim.now_us() < end_us;) {
        run.scan();
        figures.all.add(run.error_us);
        if (minute == 0) figures.first_minute.add(run.error_us);
        if (minute == 10) figures.last_minute.add(run.error_us);
      }
      if (minute >= 9) figures.worst_skew_ppm = std::max(figures.worst_skew_ppm, std::abs(run.skew_error_ppm()));
      if (stops) run.synchronise(20);
    }
    figures.outside += run.outside;
    figures.contradictions += run.clock.contradictions();
  }
  std::printf(
      "grid %4.0f us, skew %4.0f ppm, warm-up %2.0f ppm, stops %d: rms all %5.1f us, first minute %5.1f, last %5.1f; "
      "skew within %.2f ppm\n",
      options.grid_us, options.skew_ppm, options.warm_up_ppm, stops ? 1 : 0, figures.all.rms_us(),
      figures.first_minute.rms_us(), figures.last_minute.rms_us(), figures.worst_skew_ppm);
  return figures;
}

class Crystals : public ::testing::TestWithParam<std::tuple<double, double, bool>> {
 protected:
  SimOptions options() const {
    SimOptions options;
    options.skew_ppm = std::get<0>(GetParam());
    options.warm_up_ppm = std::get<1>(GetParam());
    return options;
  }
  bool stops() const { return std::get<2>(GetParam()); }
};

TEST_P(Crystals, OnTheGridOfXhci) {
  SimOptions sim = options();
  sim.grid_us = 125.0;
  const Figures figures = measure(sim, stops());
  EXPECT_EQ(figures.outside, 0);
  EXPECT_EQ(figures.contradictions, 0U);
  EXPECT_LE(figures.all.rms_us(), 100.0);
  EXPECT_LE(figures.worst_skew_ppm, 2.0);
}

TEST_P(Crystals, OnTheGridOfFullSpeedFrames) {
  const Figures figures = measure(options(), stops());
  EXPECT_EQ(figures.outside, 0);
  EXPECT_EQ(figures.contradictions, 0U);
  EXPECT_LE(figures.first_minute.rms_us(), 600.0);
  EXPECT_LE(figures.last_minute.rms_us(), 400.0);
  EXPECT_LE(figures.worst_skew_ppm, 2.0);
}

INSTANTIATE_TEST_SUITE_P(SensorClock, Crystals,
                         ::testing::Values(std::tuple(0.0, 0.0, true), std::tuple(50.0, 0.0, false),
                                           std::tuple(200.0, 0.0, true), std::tuple(-200.0, 0.0, true),
                                           std::tuple(-150.0, 6.0, false), std::tuple(100.0, -8.0, true)));

TEST(SensorClock, TheBoundHoldsWhateverTheRotorAndThePacketsDo) {
  for (const double rotor_ppm : {0.0, 3.0, -2000.0, 15'000.0}) {
    for (const double late_share : {0.0, 0.5}) {
      SimOptions options;
      options.rotor_ppm = rotor_ppm;
      options.late_share = late_share;
      options.late_us = 8000.0;
      options.grid_us = 125.0;
      Ride run(options, 7);
      run.synchronise(150);
      run.scan_for(2.0 * kMinute_us);
      EXPECT_EQ(run.outside, 0) << rotor_ppm << " " << late_share;
      EXPECT_EQ(run.lost, 0U) << rotor_ppm;
      EXPECT_EQ(run.repeated, 0U) << rotor_ppm;
    }
  }
}

TEST(SensorClock, WithoutTm1TheBoundStillHoldsAndSaysThatItIsUnsure) {
  SimOptions options;
  Ride run(options);
  EXPECT_TRUE(run.scan().unsure);
  run.scan_for(kMinute_us);
  EXPECT_TRUE(run.scan().unsure);
  EXPECT_EQ(run.outside, 0);
}

TEST(SensorClock, TheOffsetOfTheFirstBeamIsConfigured) {
  SimOptions options;
  options.stamp_to_first_beam_us = 3125.0;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(kMinute_us);
  EXPECT_EQ(run.outside, 0);
}

TEST(SensorClock, NothingJumpsWhereTheCounterWraps) {
  SimOptions options;
  options.first_device_ms = (1U << 24) - 30'000;  // wraps half a minute after the start
  options.grid_us = 125.0;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(20e6);
  std::int64_t last_ns = run.scan().first_beam_mono_ns;
  for (int i = 0; i < 1000; ++i) {
    const ScanTime time = run.scan();
    ASSERT_FALSE(time.first_of_epoch);
    ASSERT_EQ(time.lost_before, 0U);
    ASSERT_NEAR(static_cast<double>(time.first_beam_mono_ns - last_ns), 25e6, 0.3e6);
    last_ns = time.first_beam_mono_ns;
  }
  EXPECT_EQ(run.outside, 0);
  EXPECT_EQ(run.clock.epoch(), 0U);
}

// 80 minutes are more than 2^32 microseconds.
TEST(SensorClock, LongRunsKeepTheirBoundsAndCounts) {
  SimOptions options;
  options.skew_ppm = 120.0;
  options.first_device_ms = (1U << 24) - 60'000;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(80.0 * kMinute_us);
  EXPECT_EQ(run.outside, 0);
  EXPECT_EQ(run.lost + run.repeated, 0U);
  EXPECT_EQ(run.clock.contradictions(), 0U);
  EXPECT_EQ(run.clock.epoch(), 0U);
  EXPECT_LT(std::abs(run.error_us), 600.0);
}

TEST(SensorClock, LostAndRepeatedScansAreCountedExactly) {
  SimOptions options;
  options.rotor_ppm = 700.0;
  Ride run(options);
  run.synchronise(50);
  std::uint64_t lost = 0;
  std::uint64_t repeated = 0;
  std::uint64_t index = 0;
  for (int i = 0; i < 2000; ++i) {
    const int gap = i % 37 == 5 ? 1 + i % 23 : 0;
    run.sim.lose(gap);
    const SensorSim::Scan scan = run.sim.next_scan();
    const ScanTime time = run.clock.add_scan(scan.device_ms, scan.first_byte_ns);
    const auto expected = static_cast<std::uint64_t>(i == 0 ? 0 : gap);
    lost += expected;
    index += i == 0 ? 0 : 1 + expected;
    ASSERT_EQ(time.lost_before, expected) << i;
    ASSERT_EQ(time.index, index);
    if (i % 50 == 7) {
      ASSERT_TRUE(run.clock.add_scan(scan.device_ms, scan.first_byte_ns + 1'000'000).repeated);
      ++repeated;
    }
  }
  EXPECT_EQ(run.clock.lost(), lost);
  EXPECT_EQ(run.clock.repeated(), repeated);
}

TEST(SensorClock, ARestartOfTheCounterIsANewEpochAndNotAWrap) {
  SimOptions options;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(kMinute_us);
  for (std::uint32_t restarts = 1; restarts <= 3; ++restarts) {
    run.sim.restart_clock();
    const ScanTime first = run.scan();
    EXPECT_TRUE(first.first_of_epoch);
    EXPECT_TRUE(first.unsure);
    EXPECT_EQ(first.index, 0U);
    EXPECT_EQ(run.clock.epoch(), restarts);
    EXPECT_LE(first.error_bound_ns, 40'000'000);
    run.scan_for(30e6);
    // The rate and the sensor's delay are known from before: good times without TM1.
    EXPECT_LT(std::abs(run.error_us), 1500.0);
  }
  EXPECT_EQ(run.outside, 0);
  EXPECT_EQ(run.lost, 0U);
}

TEST(SensorClock, AfterAReconnectTimesGoOnAtOnceWithAWiderBound) {
  SimOptions options;
  options.grid_us = 125.0;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(kMinute_us);
  const std::int64_t before_ns = run.scan().error_bound_ns;
  run.sim.rest(1.5e6);
  run.clock.begin_epoch();
  const ScanTime first = run.scan();
  EXPECT_TRUE(first.first_of_epoch);
  EXPECT_GT(first.error_bound_ns, before_ns);
  run.scan_for(1e6);
  EXPECT_LT(run.scan().error_bound_ns, 2'000'000);
  EXPECT_FALSE(run.scan().unsure);
  EXPECT_EQ(run.outside, 0);
}

// The sensor is silent for two hours (a long pause): the wrap is still found.
TEST(SensorClock, ALongSilenceIsNoNewEpoch) {
  SimOptions options;
  options.first_device_ms = (1U << 24) - 3'600'000;  // the counter wraps in the pause
  Ride run(options);
  run.synchronise(150);
  run.scan_for(kMinute_us);
  run.sim.rest(7.2e9);
  run.synchronise(20);
  EXPECT_EQ(run.clock.epoch(), 0U);
  run.scan_for(kMinute_us);
  EXPECT_EQ(run.clock.epoch(), 0U);
  EXPECT_EQ(run.outside, 0);
}

TEST(UsbGrid, IsReadFromTheArrivalsOfReplies) {
  for (const double grid_us : {125.0, 1000.0}) {
    for (std::uint32_t seed = 1; seed <= 20; ++seed) {
      SimOptions options;
      options.grid_us = grid_us;
      SensorSim sim(options, seed);
      std::vector<std::int64_t> received_ns;
      for (int i = 0; i < 150; ++i) {
        received_ns.push_back(sim.ask_time().received_ns);
        sim.rest(sim.uniform(0.0, 38e3));
      }
      EXPECT_EQ(measure_usb_grid_us(received_ns), grid_us) << "seed " << seed;
      EXPECT_EQ(measure_usb_grid_us(std::span(received_ns).first(19)), 1000.0);
    }
  }
}

// A rotor that jitters more than promised: the millisecond of the stamp still holds, and the break is counted.
TEST(SensorClock, ARestlessRotorCostsPrecisionAndIsCounted) {
  SimOptions options;
  options.jitter_us = 300.0;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(2.0 * kMinute_us);
  EXPECT_GT(run.clock.contradictions(), 0U);
  EXPECT_EQ(run.lost + run.repeated, 0U);
  EXPECT_LT(std::abs(run.error_us), 2000.0);
}

// A crystal that breaks the promise (5 ppm in a second): bounds are begun anew and the break is counted.
TEST(SensorClock, ABrokenPromiseIsCountedAndHealed) {
  SimOptions options;
  options.grid_us = 125.0;
  options.warm_up_ppm = 200.0;
  options.warm_up_s = 20.0;
  options.skew_ppm = -100.0;
  Ride run(options);
  run.synchronise(150);
  run.scan_for(3.0 * kMinute_us);
  EXPECT_GT(run.clock.contradictions(), 0U);
  run.scan_for(5.0 * kMinute_us);
  run.synchronise(150);
  run.scan_for(kMinute_us);
  EXPECT_LT(std::abs(run.skew_error_ppm()), 5.0);
}

// A host so busy that not one of two seconds' scans is prompt breaks the promise of the USB grid. What was learnt from
// such scans must not outlive them: bounds may be wide afterwards, never false.
TEST(SensorClock, AHostThatIsLateForSecondsLeavesNoFalseBound) {
  for (const double grid_us : {125.0, 1000.0}) {
    for (std::uint32_t seed = 1; seed <= 6; ++seed) {
      SimOptions options;
      options.grid_us = grid_us;
      options.skew_ppm = seed % 2 == 0 ? 80.0 : -80.0;
      Ride run(options, seed);
      run.synchronise(150);
      run.scan_for(seed <= 3 ? 0.1e6 : kMinute_us);  // busy from the start on, or later
      run.late_us = 6'000.0;
      run.scan_for(12e6);
      run.late_us = 0.0;
      run.scan_for(0.5e6);  // the first prompt scan tells
      run.outside = 0;
      run.scan_for(3.0 * kMinute_us);
      EXPECT_EQ(run.outside, 0) << "grid " << grid_us << ", seed " << seed;
      EXPECT_LT(std::abs(run.error_us), 1500.0) << "grid " << grid_us << ", seed " << seed;
      EXPECT_GT(run.clock.contradictions(), 0U);
    }
  }
}

}  // namespace
}  // namespace submapd::driver::test
