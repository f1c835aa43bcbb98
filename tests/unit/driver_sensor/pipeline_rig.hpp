// Sensor, clock and rings facing an emulated sensor in virtual time; each scan that comes out is held against the
// truth.
#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "driver/scan_pipeline.hpp"
#include "tests/unit/driver_sensor/sensor_rig.hpp"

namespace submapd::driver::test {

// The rig's own sink passes on to a real pipeline.
class PipelineRig {
 public:
  explicit PipelineRig(SimSensorOptions sim_options = {}, ClockOptions clock = {}, std::size_t mapper_slots = 64)
      : mapper_ring(mapper_slots),
        recorder_ring(64),
        pipeline(clock, {&mapper_ring, &recorder_ring}),
        rig_(std::move(sim_options), SensorOptions{}) {
    rig_.forward_to = &pipeline;
    rig_.run(2.0);
    rig_.plug_in();
  }

  // Runs until that many scans came out of the recorder's ring, at most a minute more than they take.
  void run_to_scans(std::uint64_t count) {
    rig_.run_until(0.025 * static_cast<double>(count) + 60.0, [&] {
      drain();
      return handed_on_to_recorder >= count;
    });
  }

  std::uint64_t handed_on = 0;
  std::uint64_t handed_on_to_recorder = 0;
  std::uint64_t outside_bound = 0;  // the true first beam is not where the scan says
  std::uint64_t wrong_ranges = 0;
  std::uint64_t after_fault = 0;
  std::uint64_t epochs = 0;
  std::size_t samples = 0;
  std::size_t samples_before_last_epoch = 0;
  DeviceScan last;
  bool drain_mapper = true;
  ScanRing mapper_ring;
  ScanRing recorder_ring;
  ScanPipeline pipeline;

  SensorRig& rig() { return rig_; }

 private:
  void drain() {
    samples = rig_.samples.size();
    while (drain_mapper && mapper_ring.front() != nullptr) {
      mapper_ring.pop();
      ++handed_on;
    }
    while (const DeviceScan* const scan = recorder_ring.front()) {
      judge(*scan);
      last = *scan;
      recorder_ring.pop();
      ++handed_on_to_recorder;
    }
  }
  void judge(const DeviceScan& scan) {
    // A stamp is unique but for the epochs: the latest measured with it.
    const SimScanTruth* truth = nullptr;
    for (auto [key, candidate] = std::pair(rig_.last_truth.epoch + 1, &rig_.truth); key-- > 0 && truth == nullptr;) {
      const auto found = candidate->find({key, scan.device_ms});
      truth = found == candidate->end() ? nullptr : &found->second;
    }
    if (truth == nullptr) {
      ++wrong_ranges;
      return;
    }
    const std::int64_t error_ns = scan.first_beam_mono_ns - truth->first_beam_ns;
    outside_bound += std::abs(error_ns) > scan.error_bound_ns ? 1U : 0U;
    const std::vector<std::uint32_t> ranges_mm(scan.ranges_mm.begin(), scan.ranges_mm.begin() + scan.beams);
    wrong_ranges += hash_ranges(ranges_mm) != truth->ranges_hash ? 1U : 0U;
    after_fault += (scan.flags & kScanAfterFault) != 0 ? 1U : 0U;
    if ((scan.flags & kScanFirstOfEpoch) != 0 && handed_on_to_recorder > 0) {
      ++epochs;
      samples_before_last_epoch = samples;
    }
  }

  SensorRig rig_;
};

}  // namespace submapd::driver::test
