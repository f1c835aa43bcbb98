// From a scanner's undamaged scans to stamped scans in rings: the last step on the USB thread.
//
// One for each role, kept while scanners come and go, so that what is known of the clock survives a cable that is
// pulled. Threads: the event thread, which is the rings' producer. Neither allocates nor locks; a full ring drops the
// scan and counts it, and the other ring still gets it.
#pragma once

#include <array>
#include <cstdint>

#include "driver/clock/sensor_clock.hpp"
#include "driver/ring/scan_ring.hpp"
#include "driver/sensor.hpp"

namespace submapd::driver {

// Knows where odometry has the cart. Asked once for each scan, on the event thread: neither allocates nor locks.
class OdometrySource {
 public:
  // False if it does not know. Instants come in their order.
  [[nodiscard]] virtual bool at(std::int64_t mono_ns, Odometry& odometry) noexcept = 0;

 protected:
  ~OdometrySource() = default;
};

class ScanPipeline final : public SensorSink {
 public:
  static constexpr std::size_t kMaxRings = 2;  // mapper and recorder

  // REQUIRES: the rings outlive the pipeline; nullptr where there is none.
  ScanPipeline(const ClockOptions& clock, std::array<ScanRing*, kMaxRings> rings)
      : assumed_grid_us_(clock.usb_grid_us), clock_(clock), rings_(rings) {}
  ScanPipeline(const ScanPipeline&) = delete;
  ScanPipeline& operator=(const ScanPipeline&) = delete;
  ~ScanPipeline() = default;

  // Every ring's scan gets the same. Before the first scan; must outlive the pipeline.
  void join_with(OdometrySource& odometry) { odometry_ = &odometry; }

  void on_scan(const scip::ScanData& scan) noexcept override;
  void on_damaged_scan() noexcept override { after_fault_ = true; }
  void on_time(const TimeSample& sample) noexcept override;
  void on_new_clock() noexcept override;
  [[nodiscard]] bool knows_clock() const noexcept override { return knows_clock_; }

  // Event thread only, or after it has ended.
  [[nodiscard]] const SensorClock& clock() const { return clock_; }

 private:
  [[nodiscard]] bool fill(DeviceScan& slot, const scip::ScanData& scan, const ScanTime& time) const noexcept;

  double assumed_grid_us_;
  SensorClock clock_;
  std::array<ScanRing*, kMaxRings> rings_;
  OdometrySource* odometry_ = nullptr;
  std::array<std::int64_t, 150> replies_ns_{};  // arrivals of TM1 replies on this line
  std::size_t replies_ = 0;
  bool measure_grid_ = false;  // replies came since it was measured
  bool knows_clock_ = false;
  bool after_fault_ = false;
};

}  // namespace submapd::driver
