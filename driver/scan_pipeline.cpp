#include "driver/scan_pipeline.hpp"

#include "driver/clock/usb_grid.hpp"

namespace submapd::driver {

void ScanPipeline::on_time(const TimeSample& sample) noexcept {
  clock_.add_time_reply(sample.sent_ns, sample.received_ns, sample.device_ms);
  knows_clock_ = true;
  if (replies_ < replies_ns_.size()) {
    replies_ns_[replies_++] = sample.received_ns;
    measure_grid_ = true;
  }
}

// Also said when the scanner comes back, perhaps at a port with another grid.
void ScanPipeline::on_new_clock() noexcept {
  clock_.begin_epoch();
  clock_.set_usb_grid_us(assumed_grid_us_);
  replies_ = 0;
  measure_grid_ = false;
}

// False if the scan does not fit a slot, which no configuration of ours asks for.
bool ScanPipeline::fill(DeviceScan& slot, const scip::ScanData& scan, const ScanTime& time) const noexcept {
  if (!set_values(scan, slot)) {
    return false;
  }
  slot.first_beam_mono_ns = time.first_beam_mono_ns;
  slot.error_bound_ns = time.error_bound_ns;
  slot.index = time.index;
  slot.lost = clock_.lost();
  slot.repeated = clock_.repeated();
  slot.epoch = clock_.epoch();
  slot.flags |= (time.first_of_epoch ? kScanFirstOfEpoch : 0U) | (time.unsure ? kScanTimeUnsure : 0U) |
                (after_fault_ ? kScanAfterFault : 0U);
  return true;
}

void ScanPipeline::on_scan(const scip::ScanData& scan) noexcept {
  if (measure_grid_) {
    measure_grid_ = false;
    clock_.set_usb_grid_us(measure_usb_grid_us({replies_ns_.data(), replies_}));
  }
  const ScanTime time = clock_.add_scan(static_cast<std::uint32_t>(scan.time), scan.frame.first_byte_ns);
  if (time.repeated) {
    return;
  }
  Odometry place;
  const bool knows_place = odometry_ != nullptr && odometry_->at(time.first_beam_mono_ns, place);
  for (ScanRing* const ring : rings_) {
    DeviceScan* const slot = ring == nullptr ? nullptr : ring->claim();
    if (slot != nullptr && fill(*slot, scan, time)) {
      if (knows_place) {
        slot->odometry = place;
        slot->flags |= kScanHasOdometry;
      }
      ring->publish();
    }
  }
  after_fault_ = false;
}

}  // namespace submapd::driver
