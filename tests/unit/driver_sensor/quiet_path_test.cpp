// From the transfer's bytes to the ring our code neither allocates nor locks: counted over 100 000 scans.
#include <gtest/gtest.h>

#include "driver/scan_pipeline.hpp"
#include "tests/support/call_counter.hpp"
#include "tests/unit/driver_sim/sim_rig.hpp"

namespace submapd::driver::test {
namespace {

using namespace submapd::test;  // the counters

// Only what lies between the transfer's completion and the ring is armed.
class ArmedRig : private ByteLink, private SensorOwner {
 public:
  ArmedRig()
      : sim_({}, turning_ranges(), {}), ring_(64), pipeline_({}, {&ring_, nullptr}), sensor_(options(), "1-1", *this) {
    sim_.power_on(0);
    now_ns_ = 2'000'000'000;  // it has booted
    while (sim_.take(now_ns_)) {
    }
    sensor_.on_open(*this, now_ns_);
  }

  void run(std::uint64_t scans) {
    const std::uint64_t end = sensor_.counters().scans + scans;
    while (sensor_.counters().scans < end) {
      now_ns_ = std::max(now_ns_, std::min(sim_.next_event_ns(), sensor_.next_time_ns()));
      while (const auto output = sim_.take(now_ns_)) {
        deliver(output->bytes);
      }
      if (sensor_.next_time_ns() <= now_ns_) {
        static_cast<LinkClient&>(sensor_).on_time(now_ns_);
      }
      while (ring_.front() != nullptr) {
        ring_.pop();
      }
    }
  }
  bool watch = false;

 private:
  static SensorOptions options() {
    SensorOptions options;
    options.first_samples = 20;
    return options;
  }
  void deliver(std::span<const std::uint8_t> bytes) {
    while (!bytes.empty()) {
      const std::size_t length = std::min<std::size_t>(512, bytes.size());
      armed = watch;
      sensor_.on_bytes(bytes.first(length), now_ns_, 0);
      armed = false;
      bytes = bytes.subspan(length);
    }
  }
  bool write(std::span<const std::uint8_t> bytes) noexcept override {
    sim_.receive(now_ns_, bytes);
    return true;
  }
  void reset() noexcept override {}
  Expected<SensorAssignment> assign(const SensorIdentity&) override {
    return SensorAssignment{&pipeline_, false, false};
  }
  void on_status(const SensorStatus&) noexcept override {}

  std::int64_t now_ns_ = 0;
  SimSensor sim_;
  ScanRing ring_;
  ScanPipeline pipeline_;
  Sensor sensor_;
};

TEST(QuietPath, TheCountersCount) {
  expect_the_counters_count();
}

TEST(QuietPath, NothingIsAllocatedOrLockedOnTheWayToTheRing) {
#if SUBMAPD_COUNTS_CALLS
  constexpr std::uint64_t kScans = 100'000;
#else
  constexpr std::uint64_t kScans = 100;  // nothing is counted here
#endif
  ArmedRig rig;
  rig.run(10);  // the start-up may
  allocations = 0;
  locks = 0;
  rig.watch = true;
  rig.run(kScans);
  EXPECT_EQ(allocations, 0U);
  EXPECT_EQ(locks, 0U);
}

}  // namespace
}  // namespace submapd::driver::test
