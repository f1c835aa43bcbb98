#include "driver/device_scan.hpp"

#include <algorithm>
#include <limits>

namespace submapd::driver {
namespace {

std::uint16_t narrow(std::uint32_t value) {
  return static_cast<std::uint16_t>(std::min<std::uint32_t>(value, std::numeric_limits<std::uint16_t>::max()));
}

}  // namespace

bool set_values(const scip::ScanData& scan, DeviceScan& slot) noexcept {
  if (scan.ranges_mm.size() > DeviceScan::kMaxBeams || scan.request.multi_echo()) return false;
  slot.device_ms = static_cast<std::uint32_t>(scan.time & 0xFFFFFF);
  slot.arrival_first_mono_ns = scan.frame.first_byte_ns;
  slot.arrival_last_mono_ns = scan.frame.last_byte_ns;
  slot.beams = static_cast<std::uint32_t>(scan.ranges_mm.size());
  slot.flags = scan.intensities.empty() ? 0U : kScanHasIntensities;
  std::transform(scan.ranges_mm.begin(), scan.ranges_mm.end(), slot.ranges_mm.begin(), narrow);
  std::transform(scan.intensities.begin(), scan.intensities.end(), slot.intensities.begin(), narrow);
  return true;
}

}  // namespace submapd::driver
