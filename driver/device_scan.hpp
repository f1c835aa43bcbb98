// One scan as the driver hands it on: what the sensor measured, when, and how sure we are of that.
//
// A plain value of fixed size, filled in place in a slot of the ScanRing: copying it never allocates. It has no thread
// of its own; whoever holds the slot owns it.
#pragma once

#include <array>
#include <cstdint>

#include "driver/scip/event.hpp"

namespace submapd::driver {

// What is special about a scan; bits of DeviceScan::flags.
enum ScanFlag : std::uint32_t {
  kScanFirstOfEpoch = 1U << 0,  // the sensor's clock began anew before this scan: `index` and `device_ms` restart
  kScanTimeUnsure =
      1U << 1,  // the bound was widened: clock taken over from before a reconnect, or not yet synchronised
  kScanHasIntensities = 1U << 2,
  kScanAfterFault = 1U << 3,  // a damaged frame came between this scan and the one before
  kScanHasOdometry = 1U << 4,
};

// Where somebody else's odometry has the cart, in a frame of its own.
struct Odometry {
  double x_m = 0.0;
  double y_m = 0.0;
  double yaw_rad = 0.0;
};

struct DeviceScan {
  static constexpr std::uint32_t kMaxBeams = 1081;  // UTM-30LX: 270 deg in steps of 0.25 deg

  std::int64_t first_beam_mono_ns = 0;     // CLOCK_MONOTONIC when the first beam was measured, best estimate
  std::int64_t error_bound_ns = 0;         // the true instant lies within +-this of first_beam_mono_ns
  std::int64_t arrival_first_mono_ns = 0;  // when the transfer with the frame's first byte completed
  std::int64_t arrival_last_mono_ns = 0;   // ... with its last byte
  std::uint64_t index = 0;                 // turns of the rotor since the epoch's first scan; a gap is a lost scan
  std::uint64_t lost = 0;                  // scans lost since the sensor was opened, this gap included
  std::uint64_t repeated = 0;              // scans received twice (and not handed on) since the sensor was opened
  std::uint32_t device_ms = 0;             // the sensor's own stamp, 24 bits, as it was sent
  std::uint32_t epoch = 0;                 // counts restarts of the sensor's clock
  std::uint32_t flags = 0;                 // of ScanFlag
  std::uint32_t beams = 0;                 // values of ranges_mm (and intensities) in use
  Odometry odometry;                       // at the first beam; only with kScanHasOdometry
  // Raw values from first_step on, counter-clockwise. Below the sensor's DMIN (23) a value is an error code, not a
  // distance. What the sensor sends above 65535 is stored as 65535: both mean nothing usable.
  std::array<std::uint16_t, kMaxBeams> ranges_mm{};
  std::array<std::uint16_t, kMaxBeams> intensities{};  // no unit; only with kScanHasIntensities
};

// Fills a slot with what the sensor sent: values, stamp, arrivals, flags. Times, index and counts are the clock's to
// set. False, and the slot untouched, for a scan that does not fit: more beams, or several echoes a beam.
bool set_values(const scip::ScanData& scan, DeviceScan& slot) noexcept;

}  // namespace submapd::driver
