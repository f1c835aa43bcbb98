// One sweep of the horizontal laser as every room hands it on: ranges, the geometry of its beams, and its stamp.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"

namespace submapd {

inline constexpr std::uint16_t kNoReturn_mm = 0;   // beam without a return: no evidence
inline constexpr std::uint16_t kErrorCode_mm = 1;  // sensor's error code 1: no evidence unless configured as free

// How a scan's beams lie in space and time. Beam i points at first_angle_rad + i * angle_step_rad in the sensor's frame
// and is measured i / (beams - 1) * sweep_s after the scan's stamp.
struct ScanGeometry {
  double first_angle_rad = -0.75 * std::numbers::pi;
  double angle_step_rad = std::numbers::pi / 720.0;
  double sweep_s = 0.0;       // first to last beam; 0: the scan is instantaneous
  double range_min_m = 0.1;   // shorter ranges are the cart itself or error codes
  double range_max_m = 30.0;  // longer ranges are no return
  Pose2 base_from_sensor;     // pose of the sensor in the base frame
  friend bool operator==(const ScanGeometry&, const ScanGeometry&) = default;
};

struct Scan {
  std::int64_t stamp_us = 0;  // of the first beam; wall clock of the run (or of the log)
  std::uint64_t index = 0;    // 0, 1, 2, ... within the run; a gap is a lost scan
  ScanGeometry geometry;
  std::vector<std::uint16_t> ranges_mm;  // one a beam; kNoReturn_mm, kErrorCode_mm, or millimetres
  std::optional<Pose2> odometry;         // raw odometry pose of the base at the stamp, if there is any
};

}  // namespace submapd
