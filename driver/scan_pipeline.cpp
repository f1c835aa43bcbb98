#include "driver/scan_pipeline.hpp"

#include <algorithm>
#include <limits>
#include <span>

namespace submapd::driver {
namespace {

constexpr std::uint32_t kMost = std::numeric_limits<std::uint16_t>::max();

void copy_values(std::span<const std::uint32_t> values, std::size_t count, std::span<std::uint16_t> out) {
  std::transform(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count), out.begin(),
                 [](std::uint32_t value) { return static_cast<std::uint16_t>(std::min(value, kMost)); });
}

}  // namespace

void ScanPipeline::on_time(const TimeSample& sample) noexcept {
  clock_.add_time_reply(sample.sent_ns, sample.received_ns, sample.device_ms);
  knows_clock_ = true;
}

void ScanPipeline::fill(DeviceScan& slot, const scip::ScanData& scan, const ScanTime& time) const noexcept {
  slot.first_beam_mono_ns = time.first_beam_mono_ns;
  slot.error_bound_ns = time.error_bound_ns;
  slot.arrival_first_mono_ns = scan.frame.first_byte_ns;
  slot.arrival_last_mono_ns = scan.frame.last_byte_ns;
  slot.index = time.index;
  slot.lost = clock_.lost();
  slot.repeated = clock_.repeated();
  slot.device_ms = static_cast<std::uint32_t>(scan.time);
  slot.epoch = clock_.epoch();
  slot.flags = (time.first_of_epoch ? kScanFirstOfEpoch : 0U) | (time.unsure ? kScanTimeUnsure : 0U) |
               (scan.intensities.empty() ? 0U : kScanHasIntensities) | (after_fault_ ? kScanAfterFault : 0U);
  const std::size_t beams = std::min<std::size_t>(scan.ranges_mm.size(), DeviceScan::kMaxBeams);
  slot.beams = static_cast<std::uint32_t>(beams);
  copy_values(scan.ranges_mm, beams, slot.ranges_mm);
  if (!scan.intensities.empty()) {
    copy_values(scan.intensities, beams, slot.intensities);
  }
}

void ScanPipeline::on_scan(const scip::ScanData& scan) noexcept {
  const ScanTime time = clock_.add_scan(static_cast<std::uint32_t>(scan.time), scan.frame.first_byte_ns);
  if (time.repeated) {
    return;
  }
  for (ScanRing* const ring : rings_) {
    DeviceScan* const slot = ring == nullptr ? nullptr : ring->claim();
    if (slot != nullptr) {
      fill(*slot, scan, time);
      ring->publish();
    }
  }
  after_fault_ = false;
}

}  // namespace submapd::driver
