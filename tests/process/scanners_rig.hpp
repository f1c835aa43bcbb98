// The whole driver but the ring and the clock, facing emulated scanners behind the real libusb.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "driver/scanners.hpp"
#include "tests/process/host_thread.hpp"
#include "tests/unit/driver_sim/sim_rig.hpp"
#include "tools/hokuyo_sim/umockdev_front.hpp"

namespace submapd::driver::test {

struct ReceivedScan {
  std::int64_t first_byte_ns = 0;
  std::int64_t last_byte_ns = 0;
  std::uint32_t stamp_ms = 0;
  std::uint64_t hash = 0;
};

class RecordingSink final : public SensorSink {
 public:
  RecordingSink(std::mutex& mutex, std::condition_variable& changed) : mutex_(mutex), changed_(changed) {}

  void on_scan(const scip::ScanData& scan) noexcept override {
    {
      const std::lock_guard lock(mutex_);
      scans.push_back({scan.frame.first_byte_ns, scan.frame.last_byte_ns, static_cast<std::uint32_t>(scan.time),
                       hash_ranges(scan.ranges_mm)});
    }
    changed_.notify_all();
  }
  void on_damaged_scan() noexcept override {
    const std::lock_guard lock(mutex_);
    ++damaged;
  }
  void on_time(const TimeSample& sample) noexcept override {
    const std::lock_guard lock(mutex_);
    samples.push_back(sample);
  }
  void on_new_clock() noexcept override {
    const std::lock_guard lock(mutex_);
    ++new_clocks;
  }
  bool knows_clock() const noexcept override { return clock_known; }

  // Guarded by the rig's mutex.
  std::vector<ReceivedScan> scans;
  std::vector<TimeSample> samples;
  int damaged = 0;
  int new_clocks = 0;
  bool clock_known = true;  // set before the start

 private:
  std::mutex& mutex_;
  std::condition_variable& changed_;
};

constexpr const char* kSerials[] = {"00903971", "00900001"};

class ScannersRig : public HostThread {
 public:
  ScannersRig() {
    options.roles[0].serial = kSerials[0];
    options.roles[1].serial = kSerials[1];
  }
  ~ScannersRig() { stop(); }

  // Scanner 0 or 1, at port 1-1 or 1-2. It boots at once unless told otherwise.
  void plug(std::size_t index, const std::vector<std::string>& script = {}, SimSensorOptions sensor = {},
            std::int64_t boot_ns = 0) {
    sensor.serial = sensor.serial == SimSensorOptions{}.serial ? kSerials[index] : sensor.serial;
    sensor.boot_ns = boot_ns;
    sensor.seed += index;
    for (const std::string& fault : script) {
      sensor.script.push_back(*parse_sim_fault(fault));
    }
    tools::EmulatedScanner scanner;
    scanner.port = index == 0 ? "1-1" : "1-2";
    scanner.sensor = std::move(sensor);
    scanner.ranges = turning_ranges;
    scanner.truth = [this, index](const SimScanTruth& scan) {
      const std::lock_guard lock(mutex);
      truth[index].push_back(scan);
    };
    front.plug(std::move(scanner));
  }

  void start() {
    scanners = std::make_unique<Scanners>(options, std::array<SensorSink*, 2>{&sinks[0], &sinks[1]});
    start_host({}, *scanners);
  }

  bool wait_for_scans(std::size_t index, std::size_t count) {
    return wait([&] { return sinks[index].scans.size() >= count; });
  }
  // True as soon as a snapshot fulfils the condition.
  bool wait_for_snapshot(const std::function<bool(const std::vector<ScannerInfo>&)>& condition, int seconds = 15) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
    while (std::chrono::steady_clock::now() < end) {
      if (condition(scanners->snapshot())) {
        return true;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));  // nobody tells of a changed snapshot
    }
    return false;
  }
  // What is wrong with the scans that came.
  struct Verdict {
    std::size_t false_scans = 0;  // say other than what was measured
    double longest_gap_s = 0.0;   // of true time between the first beams of two scans that came one after the other
  };
  [[nodiscard]] Verdict verdict(std::size_t index) {
    const std::lock_guard lock(mutex);  // the scanners measure on
    // A clock that started anew repeats its stamps, so that the latest scan measured before the arrival counts.
    std::map<std::pair<std::uint32_t, std::uint64_t>, std::vector<std::int64_t>> true_ones;
    for (const SimScanTruth& scan : truth[index]) {
      true_ones[{scan.stamp_ms, scan.ranges_hash}].push_back(scan.first_beam_ns);
    }
    Verdict verdict;
    std::int64_t before_ns = 0;
    for (const ReceivedScan& scan : sinks[index].scans) {
      const std::vector<std::int64_t>& times = true_ones[{scan.stamp_ms, scan.hash}];
      const auto later = std::upper_bound(times.begin(), times.end(), scan.last_byte_ns);
      if (later == times.begin()) {
        ++verdict.false_scans;
        continue;
      }
      const std::int64_t first_beam_ns = *std::prev(later);
      if (before_ns > 0) {
        verdict.longest_gap_s = std::max(verdict.longest_gap_s, 1e-9 * static_cast<double>(first_beam_ns - before_ns));
      }
      before_ns = first_beam_ns;
    }
    return verdict;
  }

  ScannersOptions options;
  std::array<RecordingSink, 2> sinks{RecordingSink(mutex, changed), RecordingSink(mutex, changed)};
  std::array<std::vector<SimScanTruth>, 2> truth;
  tools::UmockdevFront front;
  std::unique_ptr<Scanners> scanners;
};

}  // namespace submapd::driver::test
