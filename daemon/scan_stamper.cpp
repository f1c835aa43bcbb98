#include "daemon/scan_stamper.hpp"

#include <algorithm>
#include <utility>

#include "driver/clock/sensor_clock.hpp"

namespace submapd {

ScanGeometry utm30lx_geometry() {
  ScanGeometry geometry;
  geometry.sweep_s = driver::ClockOptions{}.sweep_us * 1e-6;
  return geometry;
}

ScanStamper::ScanStamper(RunClock clock, const ScanGeometry& geometry, std::uint64_t first_index, std::int64_t after_us)
    : clock_(std::move(clock)) {
  scan_.index = first_index;
  scan_.stamp_us = after_us;
  scan_.geometry = geometry;
  scan_.ranges_mm.reserve(driver::DeviceScan::kMaxBeams);
}

const Scan& ScanStamper::stamp(const driver::DeviceScan& measured) noexcept {
  if (!first_) {
    std::uint64_t turns = 1;
    if (measured.epoch == epoch_ && measured.index > turn_) {
      turns = measured.index - turn_;
    } else if (measured.epoch != epoch_) {
      const auto period_ns = static_cast<std::int64_t>(driver::ClockOptions{}.scan_period_us * 1e3);
      const std::int64_t since_ns = measured.first_beam_mono_ns - mono_ns_;
      turns = static_cast<std::uint64_t>(std::max<std::int64_t>((since_ns + period_ns / 2) / period_ns, 1));
    }
    scan_.index += turns;
    missing_ += turns - 1;
  }
  first_ = false;
  epoch_ = measured.epoch;
  turn_ = measured.index;
  mono_ns_ = measured.first_beam_mono_ns;
  // When the clock's bounds were broken and begin anew, the estimate may step back: the order of scans is surer.
  const std::int64_t stamp_us = clock_.utime_us(measured.first_beam_mono_ns);
  scan_.stamp_us = std::max(stamp_us, scan_.stamp_us + 1);
  scan_.ranges_mm.assign(measured.ranges_mm.begin(), measured.ranges_mm.begin() + measured.beams);
  scan_.odometry.reset();
  if ((measured.flags & driver::kScanHasOdometry) != 0) {
    scan_.odometry = Pose2{measured.odometry.x_m, measured.odometry.y_m, measured.odometry.yaw_rad};
  }
  return scan_;
}

}  // namespace submapd
