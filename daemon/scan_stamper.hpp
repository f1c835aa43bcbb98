// A driver's scan as the mapper and the raw log take it: the run's wall clock and the run's scan number.
//
// Each reader of a ring has a stamper of its own. Equal streams give equal scans, so that what the recorder writes is
// what the mapper saw. One thread; allocates nothing after construction.
#pragma once

#include <cstdint>

#include "daemon/run_clock.hpp"
#include "driver/device_scan.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

class ScanStamper {
 public:
  // The first scan gets number `first_index` and a stamp after `after_us`.
  ScanStamper(RunClock clock, const ScanGeometry& geometry, std::uint64_t first_index = 0, std::int64_t after_us = 0);

  // Numbers count the rotor's turns: a gap is a lost scan. When the sensor's clock begins anew, the time that passed
  // tells how many turns are missing. Stamps always grow. The reference is valid until the next call.
  const Scan& stamp(const driver::DeviceScan& measured) noexcept;

  [[nodiscard]] std::uint64_t missing() const { return missing_; }  // numbers left out so far

 private:
  const RunClock clock_;
  Scan scan_;
  bool first_ = true;
  std::uint32_t epoch_ = 0;
  std::uint64_t turn_ = 0;
  std::int64_t mono_ns_ = 0;
  std::uint64_t missing_ = 0;
};

// Where the beams of a UTM-30LX lie: 1081 in 270 degrees, anti-clockwise, 25 ms a turn.
[[nodiscard]] ScanGeometry utm30lx_geometry();

}  // namespace submapd
