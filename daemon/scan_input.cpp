#include "daemon/scan_input.hpp"

#include <algorithm>

#include "daemon/acquisition.hpp"
#include "daemon/lcm_input.hpp"
#include "daemon/log_input.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kLatest_us = 9'000'000'000'000'000;  // nanoseconds still fit 63 bits
constexpr std::int64_t kArrival_ns = 25'000'000;            // a scan is there when its sweep is over

void fill(driver::DeviceScan& slot, const ScanMessage& message) {
  const Scan& scan = message.scan;
  slot.first_beam_mono_ns = scan.stamp_us * 1000;
  slot.error_bound_ns = 0;
  slot.arrival_first_mono_ns = slot.arrival_last_mono_ns = slot.first_beam_mono_ns + kArrival_ns;
  slot.index = scan.index;
  slot.lost = slot.repeated = 0;
  slot.device_ms = static_cast<std::uint32_t>(std::max<std::int64_t>(message.origin.device_ms, 0) & 0xFFFFFF);
  slot.epoch = slot.flags = 0;
  if (scan.odometry) {
    slot.odometry = {scan.odometry->x, scan.odometry->y, scan.odometry->yaw};
    slot.flags |= driver::kScanHasOdometry;
  }
  slot.beams = static_cast<std::uint32_t>(scan.ranges_mm.size());
  std::copy(scan.ranges_mm.begin(), scan.ranges_mm.end(), slot.ranges_mm.begin());
}

}  // namespace

bool ScanInput::fits(const Scan& scan) const {
  return scan.ranges_mm.size() <= driver::DeviceScan::kMaxBeams && scan.geometry == geometry() && scan.stamp_us >= 0 &&
         scan.stamp_us <= kLatest_us;
}

void ScanInput::push(driver::SensorRole role, const ScanMessage& message) {
  std::array<driver::ScanRing*, 2> rings = {&recorder_ring(role), nullptr};
  if (role == driver::SensorRole::kHorizontal) rings[1] = &mapper_ring_;
  for (driver::ScanRing* const ring : rings) {
    driver::DeviceScan* const slot = ring != nullptr ? ring->claim() : nullptr;
    if (slot == nullptr) continue;  // counted by the ring
    fill(*slot, message);
    ring->publish();
  }
}

Expected<std::unique_ptr<ScanInput>> make_input(const std::string& name, const Configuration& configuration,
                                                driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell) {
  if (name == "usb") return std::make_unique<Acquisition>(configuration, mapper_bell, recorder_bell);
  if (name == "lcm") return std::make_unique<LcmInput>(configuration, mapper_bell, recorder_bell);
  Expected<std::unique_ptr<LogInput>> input = LogInput::open(name, configuration, mapper_bell, recorder_bell);
  if (!input) return failure(input.error());
  return std::move(*input);
}

}  // namespace submapd
