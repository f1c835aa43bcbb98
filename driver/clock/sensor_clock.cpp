#include "driver/clock/sensor_clock.hpp"

#include <algorithm>
#include <cmath>

namespace submapd::driver {
namespace {

constexpr int kWindowScans = 80;       // two seconds
constexpr int kFirstWindowScans = 10;  // doubled until it is kWindowScans
constexpr Interval kAnything{-1e12, 1e12};
constexpr double kHorizon_s = 900.0;  // of crystal and arrival; older bounds have bent away
constexpr double kRotorHorizon_s = 60.0;
constexpr int kLateWindows = 30;         // without one prompt scan, until that is how it is now
constexpr double kDelayReach_s = 120.0;  // how long after TM1 the sensor's delay is still refined
constexpr double kLatest_ms = 3000.0;    // a stamp further from the prediction is that of another epoch
constexpr double kRateKept_ppm = 20.0;   // how far the rate may move over a reset or a reconnect
constexpr double kTouch_s = 120.0;       // of the arrivals that tell the rate now
constexpr double kUs = 1e6;

LineBounds::Options crystal_options(const ClockOptions& options) {
  return {-options.max_skew_ppm, options.max_skew_ppm, options.max_skew_change_ppm_s, kHorizon_s};
}

LineBounds::Options rotor_options(const ClockOptions& options) {
  const double error_ppm = options.max_rotor_error * 1e6;
  return {-error_ppm, error_ppm, options.max_rotor_change_ppm_s, kRotorHorizon_s};
}

}  // namespace

SensorClock::SensorClock(const ClockOptions& options)
    : options_(options),
      rotor_(rotor_options(options)),
      crystal_(crystal_options(options)),
      arrival_(crystal_options(options)),
      delay_us_{0.0, options.longest_delay_us},
      delay_seen_us_(kAnything),
      window_length_(kFirstWindowScans) {}

double SensorClock::host_us(std::int64_t mono_ns) const {
  return static_cast<double>(mono_ns - origin_ns_) / 1e3;
}

Interval SensorClock::skew_ppm() const {
  const Interval both = arrival_.slope().meet(crystal_.slope());
  return both.empty() ? arrival_.slope() : both;
}

void SensorClock::begin_epoch() {
  if (!started_) return;
  const Interval rate = skew_ppm();
  const Interval allowed{std::max(rate.low - kRateKept_ppm, -options_.max_skew_ppm),
                         std::min(rate.high + kRateKept_ppm, options_.max_skew_ppm)};
  crystal_.reset(allowed);
  arrival_.reset(allowed);
  rotor_.reset();
  started_ = false;
  scanned_ = false;
  compared_ = false;
  synchronised_ = false;
  window_scans_ = 0;
  window_length_ = kFirstWindowScans;
  late_windows_ = 0;
  index_ = 0;
  ++epoch_;
}

void SensorClock::start(std::uint32_t device_ms, std::int64_t mono_ns) {
  started_ = true;
  origin_ns_ = mono_ns;
  origin_ms_ = device_ms;
  anchor_ms_ = device_ms;
  anchor_host_us_ = 0.0;
}

// The whole device time whose low 24 bits were sent: the one nearest to what the clock must show now. Good for any
// order of events and for 2.3 hours of silence.
std::int64_t SensorClock::unwrap(std::uint32_t device_ms, double host) const {
  const double predicted_ms = static_cast<double>(anchor_ms_) + (host - anchor_host_us_) / 1e3;
  const double turns = (predicted_ms - static_cast<double>(device_ms)) / static_cast<double>(kWrap_ms);
  return static_cast<std::int64_t>(device_ms) + std::llround(turns) * kWrap_ms;
}

// False: no late packet explains this stamp, the counter began anew.
bool SensorClock::continues(std::int64_t stamp_ms, double host) const {
  const double elapsed_ms = (host - anchor_host_us_) / 1e3;
  const double late_ms = static_cast<double>(anchor_ms_ - stamp_ms) + elapsed_ms;
  return std::abs(late_ms) <= kLatest_ms + options_.max_skew_ppm * 1e-6 * std::abs(elapsed_ms);
}

void SensorClock::add_time_reply(std::int64_t sent_mono_ns, std::int64_t received_mono_ns, std::uint32_t device_ms) {
  if (started_ && !continues(unwrap(device_ms, host_us(received_mono_ns)), host_us(received_mono_ns))) begin_epoch();
  if (!started_) start(device_ms, received_mono_ns);
  const double received = host_us(received_mono_ns);
  const std::int64_t stamp_ms = unwrap(device_ms, received);
  const double device = static_cast<double>(stamp_ms - origin_ms_) * 1e3;
  const auto bound = [&] {
    crystal_.below(device / kUs, received - device);
    crystal_.above((device + 1e3) / kUs, host_us(sent_mono_ns) - (device + 1e3));
  };
  bound();
  if (crystal_.contradictory()) {
    restart_if_contradictory(crystal_);
    bound();
  }
  anchor_ms_ = stamp_ms;
  anchor_host_us_ = received;
  synchronised_ = true;
  synchronised_x_ = device / kUs;
}

ScanTime SensorClock::add_scan(std::uint32_t device_ms, std::int64_t first_byte_mono_ns) {
  ScanTime result;
  if (started_) {
    const double host = host_us(first_byte_mono_ns);
    const std::int64_t stamp_ms = unwrap(device_ms, host);
    // Scans never overtake each other: a stamp that goes back is one of a new clock.
    if (!continues(stamp_ms, host) || (scanned_ && stamp_ms < last_stamp_ms_)) begin_epoch();
  }
  if (!started_) start(device_ms, first_byte_mono_ns);
  const double host = host_us(first_byte_mono_ns);
  const std::int64_t stamp_ms = unwrap(device_ms, host);

  if (scanned_) {
    const double period_ms = options_.scan_period_us / 1e3 * (1.0 + rotor_.slope().middle() / 1e6);
    const auto turns = std::llround(static_cast<double>(stamp_ms - last_stamp_ms_) / period_ms);
    if (turns == 0) {
      ++repeated_;
      result.repeated = true;
      return result;
    }
    result.lost_before = static_cast<std::uint64_t>(turns) - 1;
    lost_ += result.lost_before;
    index_ += static_cast<std::uint64_t>(turns);
  }
  result.first_of_epoch = !scanned_;
  result.index = index_;
  last_stamp_ms_ = stamp_ms;
  anchor_ms_ = stamp_ms;
  anchor_host_us_ = host;

  const Interval device = device_us(stamp_ms);
  add_arrival(device, host - options_.stamp_to_first_beam_us - options_.sweep_us);
  scanned_ = true;
  result.unsure = !compared_ || !delay_known_;

  const double offset_us = options_.stamp_to_first_beam_us;
  const Interval first_beam{host_at(device.low / kUs).range.low + device.low + offset_us,
                            host_at(device.high / kUs).range.high + device.high + offset_us};
  const double estimate = host_at(device.middle() / kUs).estimate + device.middle() + offset_us;
  const double bound = std::max(estimate - first_beam.low, first_beam.high - estimate);
  result.first_beam_mono_ns = origin_ns_ + std::llround(estimate * 1e3);
  result.error_bound_ns = static_cast<std::int64_t>(std::ceil(bound * 1e3)) + 1;
  return result;
}

// Device time since origin_ms_ of the scan with this stamp and index_: its millisecond, and within that where the rotor
// was.
Interval SensorClock::device_us(std::int64_t stamp_ms) {
  const double stamp_us = static_cast<double>(stamp_ms - origin_ms_) * 1e3;
  const double nominal_us = static_cast<double>(index_) * options_.scan_period_us;
  const double x = nominal_us / kUs;
  const auto bound = [&] {
    rotor_.below(x, stamp_us + 1e3 - nominal_us + options_.rotor_jitter_us);
    rotor_.above(x, stamp_us - nominal_us - options_.rotor_jitter_us);
  };
  bound();
  if (rotor_.contradictory()) {
    restart_if_contradictory(rotor_);
    bound();
  }
  const Interval smooth = rotor_.at(x);
  const Interval turn{nominal_us + smooth.low - options_.rotor_jitter_us,
                      nominal_us + smooth.high + options_.rotor_jitter_us};
  const Interval device = turn.meet({stamp_us, stamp_us + 1e3});
  return device.empty() ? Interval{stamp_us, stamp_us + 1e3} : device;
}

// prompt_host: host time of the stamped instant, had the bytes come without delay.
void SensorClock::add_arrival(const Interval& device, double prompt_host) {
  const double low_x = device.low / kUs;
  const double high_x = device.high / kUs;
  arrival_.below(low_x, prompt_host - device.low);
  if (arrival_.contradictory()) {
    // Nothing comes early: scans that were taken for prompt were not.
    ++contradictions_;
    arrival_.forget_lower();
    if (arrival_.contradictory()) {
      arrival_.reset();
      arrival_.below(low_x, prompt_host - device.low);
    }
    forget_delay();
    compared_ = false;
    window_scans_ = 0;
    scanned_ = false;
  }
  if (!scanned_) arrival_.above(high_x, prompt_host - device.high - options_.first_late_us);

  const double x = device.middle() / kUs;
  const double late_us = prompt_host - device.middle() - arrival_.at(x).middle();
  if (window_scans_ == 0 || late_us < window_late_us_) {
    window_late_us_ = late_us;
    window_x_ = high_x;
    window_y_ = prompt_host - device.high;
  }
  if (++window_scans_ == window_length_) end_window();
}

void SensorClock::end_window() {
  window_scans_ = 0;
  window_length_ = std::min(2 * window_length_, kWindowScans);
  const double earliest = window_y_ - options_.usb_grid_us - options_.wake_up_us;
  if (earliest <= arrival_.at(window_x_).high) {
    late_windows_ = 0;
    arrival_.above(window_x_, earliest);
  } else {
    // Not one scan was prompt: the host was busy. If that lasts, it is the line that has moved.
    ++contradictions_;
    if (++late_windows_ < kLateWindows) return;
    arrival_.reset();
    forget_delay();
    arrival_.below(window_x_, window_y_);
    arrival_.above(window_x_, earliest);
  }
  compared_ = true;
  learn_delay();
}

void SensorClock::forget_delay() {
  delay_us_ = {0.0, options_.longest_delay_us};
  delay_seen_us_ = kAnything;
  delay_known_ = false;
}

// The sensor's delay is the same at all times, so every time at which both lines are known narrows it.
void SensorClock::learn_delay() {
  if (!synchronised_ || (delay_known_ && window_x_ - synchronised_x_ > kDelayReach_s)) return;
  const Interval arrival = arrival_.at(synchronised_x_);
  const Interval crystal = crystal_at(synchronised_x_);
  const Interval seen{arrival.low - crystal.high, arrival.high - crystal.low};
  const Interval narrowed = delay_us_.meet(seen);
  if (narrowed.empty()) ++contradictions_;
  delay_us_ = narrowed.empty() ? seen : narrowed;

  const double prompt = arrival_.touching(synchronised_x_, kTouch_s);
  const Interval likely{prompt - crystal.high, prompt - crystal.low};
  const Interval both = delay_seen_us_.meet(likely);
  delay_seen_us_ = both.empty() ? likely : both;
  delay_known_ = true;
}

void SensorClock::restart_if_contradictory(LineBounds& bounds) {
  if (!bounds.contradictory()) return;
  bounds.reset();
  ++contradictions_;
}

// crystal at x from TM1; its slope is also that of the arrivals, which are newer.
Interval SensorClock::crystal_at(double x) const {
  const Interval slope = arrival_.slope();
  const double bent = options_.max_skew_change_ppm_s * std::abs(arrival_.newest_x() - crystal_.newest_x());
  return crystal_.at(x, {slope.low - bent, slope.high + bent});
}

// From TM1 itself and through the arrivals. The bounds are those of both; the estimate weighs their middles by their
// widths, as the middle of what both leave would lean away from a bound that is tight on one side only.
SensorClock::HostTime SensorClock::host_at(double x) const {
  const Interval arrival = arrival_.at(x);
  const Interval through{arrival.low - delay_us_.high, arrival.high - delay_us_.low};
  if (!synchronised_) return {through, through.middle()};
  const Interval direct = crystal_at(x);
  Interval both = through.meet(direct);
  if (both.empty()) both = direct;  // TM1 promises less
  double estimate = direct.middle();
  if (delay_known_) {
    const double width = arrival.width() + delay_seen_us_.width();
    const double weight = 1.0 / (width * width);
    const double direct_weight = 1.0 / (direct.width() * direct.width());
    const double through_middle = arrival_.touching(x, kTouch_s) - delay_seen_us_.middle();
    estimate = (weight * through_middle + direct_weight * estimate) / (weight + direct_weight);
  }
  return {both, std::clamp(estimate, both.low, both.high)};
}

}  // namespace submapd::driver
