// The driver's Sensor facing an emulated one in virtual time: hours of faults in milliseconds.
#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "driver/sensor.hpp"
#include "tests/unit/driver_sim/sim_rig.hpp"

namespace submapd::driver::test {

struct HeardScan {
  std::int64_t at_ns = 0;
  std::uint32_t stamp_ms = 0;
  std::uint64_t hash = 0;
  bool has_intensities = false;
};

class SensorRig : private ByteLink, private SensorOwner, private SensorSink {
 public:
  explicit SensorRig(SimSensorOptions sim_options = {}, SensorOptions options = quick())
      : sim(std::move(sim_options), turning_ranges(),
            [this](const SimScanTruth& scan) {
              truth[{scan.epoch, scan.stamp_ms}] = scan;
              last_truth = scan;
            }),
        sensor(options, "1-1", *this) {
    sim.power_on(0);
  }
  SensorRig(const SensorRig&) = delete;
  SensorRig& operator=(const SensorRig&) = delete;
  virtual ~SensorRig() = default;

  // A start-up that does not measure the clock: most tests are about something else.
  static SensorOptions quick() {
    SensorOptions options;
    options.first_samples = 0;
    options.later_samples = 5;
    return options;
  }

  void plug_in() {
    open_ = true;
    sensor.on_open(*this, now_ns);
  }

  // Lets the time pass until the condition holds or the time is over. True if it holds.
  template <typename Condition>
  bool run_until(double seconds, Condition&& holds) {
    const std::int64_t end_ns = now_ns + static_cast<std::int64_t>(seconds * 1e9);
    while (!holds()) {
      const std::int64_t next_ns = std::min({sim.next_event_ns(), sensor.next_time_ns(), reopen_ns_});
      if (next_ns > end_ns) {
        now_ns = end_ns;
        return false;
      }
      now_ns = std::max(now_ns, next_ns);
      serve();
    }
    return true;
  }
  void run(double seconds) {
    run_until(seconds, [] { return false; });
  }
  bool run_until_streaming(double seconds) {
    return run_until(seconds, [this] { return sensor.status().state == SensorState::kStreaming; });
  }

  // Longest time between two scans, in s.
  [[nodiscard]] double longest_gap_s() const {
    std::int64_t longest_ns = 0;
    for (std::size_t i = 1; i < scans.size(); ++i) {
      longest_ns = std::max(longest_ns, scans[i].at_ns - scans[i - 1].at_ns);
    }
    return static_cast<double>(longest_ns) * 1e-9;
  }
  // Scans that say other than what was measured.
  [[nodiscard]] std::size_t false_scans() const {
    std::set<std::pair<std::uint32_t, std::uint64_t>> true_ones;
    for (const auto& [key, scan] : truth) {
      true_ones.emplace(scan.stamp_ms, scan.ranges_hash);
    }
    return static_cast<std::size_t>(std::count_if(scans.begin(), scans.end(), [&](const HeardScan& scan) {
      return !true_ones.contains({scan.stamp_ms, scan.hash});
    }));
  }

  std::int64_t now_ns = 0;
  std::map<std::pair<std::uint64_t, std::uint32_t>, SimScanTruth> truth;  // by epoch and stamp
  SimScanTruth last_truth;
  std::vector<HeardScan> scans;
  std::vector<TimeSample> samples;
  std::vector<std::pair<SensorState, std::string>> states;
  int damaged = 0;
  int new_clocks = 0;
  int usb_resets = 0;
  bool intensity = false;
  bool self_test = false;
  bool clock_known = false;
  std::optional<Error> refusal;
  SensorSink* forward_to = nullptr;  // gets everything too
  SimSensor sim;
  Sensor sensor;

 private:
  static constexpr std::int64_t kNever = LinkClient::kNever_ns;

  void serve() {
    while (const auto output = sim.take(now_ns)) {
      if (output->kind == SimOutput::Kind::kUnplug) {
        open_ = false;
        sensor.on_close(now_ns);
      } else if (output->kind == SimOutput::Kind::kReplug) {
        reopen_ns_ = now_ns + 50'000'000;
      } else if (output->kind == SimOutput::Kind::kBytes && open_) {
        deliver(output->bytes);
      } else if (open_) {
        sensor.on_fault(output->kind == SimOutput::Kind::kStall ? LinkFault::kStall : LinkFault::kOverflow, now_ns);
      }
    }
    if (reset_asked_) {
      reset_asked_ = false;
      ++usb_resets;
      sim.usb_reset(now_ns);
      open_ = false;
      sensor.on_close(now_ns);
      reopen_ns_ = now_ns + 100'000'000;
    }
    if (now_ns >= reopen_ns_) {
      reopen_ns_ = kNever;
      plug_in();
    }
    if (open_ && sensor.next_time_ns() <= now_ns) {
      static_cast<LinkClient&>(sensor).on_time(now_ns);
    }
  }
  void deliver(const std::vector<std::uint8_t>& bytes) {
    constexpr std::size_t kTransfer = 512;
    std::span<const std::uint8_t> rest(bytes);
    while (!rest.empty()) {
      const std::size_t length = std::min(kTransfer, rest.size());
      sensor.on_bytes(rest.first(length), now_ns, offset_);
      offset_ += length;
      rest = rest.subspan(length);
    }
  }

  bool write(std::span<const std::uint8_t> bytes) noexcept override {
    if (open_) {
      sim.receive(now_ns, bytes);
    }
    return open_;
  }
  void reset() noexcept override { reset_asked_ = true; }

  Expected<SensorAssignment> assign(const SensorIdentity& /*identity*/) override {
    if (refusal) {
      return tl::unexpected(*refusal);
    }
    return SensorAssignment{this, intensity, self_test};
  }
  void on_status(const SensorStatus& status) noexcept override { states.emplace_back(status.state, status.words); }

  void on_scan(const scip::ScanData& scan) noexcept override {
    scans.push_back(
        {now_ns, static_cast<std::uint32_t>(scan.time), hash_ranges(scan.ranges_mm), !scan.intensities.empty()});
    if (forward_to != nullptr) {
      forward_to->on_scan(scan);
    }
  }
  void on_damaged_scan() noexcept override {
    ++damaged;
    if (forward_to != nullptr) {
      forward_to->on_damaged_scan();
    }
  }
  void on_time(const TimeSample& sample) noexcept override {
    samples.push_back(sample);
    if (forward_to != nullptr) {
      forward_to->on_time(sample);
    }
  }
  void on_new_clock() noexcept override {
    ++new_clocks;
    if (forward_to != nullptr) {
      forward_to->on_new_clock();
    }
  }
  bool knows_clock() const noexcept override { return clock_known || !samples.empty(); }

  bool open_ = false;
  bool reset_asked_ = false;
  std::int64_t reopen_ns_ = kNever;
  std::uint64_t offset_ = 0;
};

}  // namespace submapd::driver::test
