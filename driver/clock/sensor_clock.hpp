// When was a scan measured, on the host's clock, and how wrong can that be? From stamps, arrivals and TM1 replies.
//
// A SCIP sensor stamps each scan with a 24-bit millisecond counter, cut down to whole milliseconds, of a crystal that
// is some 100 ppm off; USB delivers on a grid of 1 ms or 125 us, sometimes late, never early. Everything here is a
// bound that cannot be wrong, unless a promise of ClockOptions is broken; nothing is averaged. Three slowly bending
// lines are bounded (LineBounds):
//   rotor    device time of scan n. Stamp s says: within [s, s + 1 ms). The rotor turns smoothly and out of step
//            with the milliseconds, so that the edges of many stamps pin down each scan to some ten microseconds.
//   crystal  host time of a device time. TM1 sent at p, answered s at q: clock s was before q, clock s + 1 ms after p.
//   arrival  host time at which the first bytes of a prompt scan with that device time come, less the sweep. No
//            scan comes before; of each two seconds' scans (of the first ten to begin with) the fastest comes at most
//            one USB grid later.
// arrival - crystal is a constant, the sensor's own delay, bounded whenever both are known (start, each longer stop),
// so that crystal follows arrival while the cart rolls and TM1 cannot be asked. Not known from all this is the instant
// at which the sensor takes the stamp: ClockOptions::stamp_to_first_beam_us.
//
// One thread, no allocation, no exceptions, about 10 kB. All host times are CLOCK_MONOTONIC in nanoseconds.
// Sources: SCIP 2.0 specification; hulls as in driver/clock/line_bounds.hpp.
#pragma once

#include <cstdint>
#include <optional>

#include "driver/clock/line_bounds.hpp"

namespace submapd::driver {

// What the bounds rest on.
struct ClockOptions {
  double stamp_to_first_beam_us = 0.0;  // the first beam is measured so long after the instant that was stamped
  double sweep_us = 18'750.0;           // first to last beam; no byte of a scan comes before its last beam
  double scan_period_us = 25'000.0;     // nominal
  double max_skew_ppm = 250.0;          // the crystal's error at most
  double max_skew_change_ppm_s = 0.02;  // ... and how fast temperature moves it
  double max_rotor_error = 0.02;        // the rotor's speed, relative to nominal
  double max_rotor_change_ppm_s = 5.0;  // ... and how fast it changes
  double rotor_jitter_us = 30.0;        // a single turn, or its stamp, is off the smooth motion by at most so much
  double usb_grid_us = 1000.0;          // 1000 on full-speed host controllers, 125 on xHCI root ports; until measured
  double wake_up_us = 150.0;            // of two seconds' scans the fastest is stamped at most so late by the host
  double longest_delay_us = 10'000.0;   // last beam to first byte of a prompt scan, until TM1 tells it better
  double first_late_us = 50'000.0;      // the first scan of an epoch is late at most so much, until others are compared
};

struct ScanTime {
  std::int64_t first_beam_mono_ns = 0;
  std::int64_t error_bound_ns = 0;  // the true instant is within +-this
  std::uint64_t index = 0;          // turns since the epoch's first scan; a gap is a lost scan
  std::uint64_t lost_before = 0;    // the gap
  bool repeated = false;            // this turn was given already: the scan is to be dropped, all else here is void
  bool first_of_epoch = false;      // the sensor's clock began anew
  bool unsure = false;              // the bound rests on longest_delay_us or first_late_us
};

class SensorClock {
 public:
  explicit SensorClock(const ClockOptions& options);

  // The grid that was measured (measure_usb_grid_us()); holds from the present window of scans on.
  void set_usb_grid_us(double grid_us) { options_.usb_grid_us = grid_us; }
  [[nodiscard]] double usb_grid_us() const { return options_.usb_grid_us; }

  // The sensor was reset, opened again or without power: its counter began anew. The crystal's rate and the sensor's
  // delay are kept, as they are the same piece of hardware: times go on at once, with wider bounds.
  void begin_epoch();

  // A TM1 reply. Replies and scans must be given in the order in which they came.
  void add_time_reply(std::int64_t sent_mono_ns, std::int64_t received_mono_ns, std::uint32_t device_ms);

  // A scan, damaged ones left out. Begins an epoch by itself if the stamp fits no wrap of the counter.
  ScanTime add_scan(std::uint32_t device_ms, std::int64_t first_byte_mono_ns);

  // Since construction.
  [[nodiscard]] std::uint64_t lost() const { return lost_; }
  [[nodiscard]] std::uint64_t repeated() const { return repeated_; }
  [[nodiscard]] std::uint32_t epoch() const { return epoch_; }
  // How often a promise of the options turned out broken, so that bounds had to be begun anew.
  [[nodiscard]] std::uint64_t contradictions() const { return contradictions_; }
  // The crystal's error, host seconds a device second less one, and its bounds.
  [[nodiscard]] Interval skew_ppm() const;

 private:
  static constexpr std::int64_t kWrap_ms = std::int64_t{1} << 24;

  // x of crystal and arrival: device seconds of the epoch. y: host microseconds since origin_ns_ less device
  // microseconds.
  [[nodiscard]] double host_us(std::int64_t mono_ns) const;
  [[nodiscard]] std::int64_t unwrap(std::uint32_t device_ms, double host) const;
  bool continues(std::int64_t stamp_ms, double host) const;
  void start(std::uint32_t device_ms, std::int64_t mono_ns);
  [[nodiscard]] Interval device_us(std::int64_t stamp_ms);
  void add_arrival(const Interval& device, double prompt_host);
  void end_window();
  void learn_delay();
  void forget_delay();
  void restart_if_contradictory(LineBounds& bounds);
  struct HostTime {
    Interval range;
    double estimate;
  };
  [[nodiscard]] HostTime host_at(double x) const;
  [[nodiscard]] Interval crystal_at(double x) const;

  ClockOptions options_;
  LineBounds rotor_;  // x: nominal seconds of turn n, y: device microseconds less nominal ones
  LineBounds crystal_;
  LineBounds arrival_;
  Interval delay_us_;         // arrival - crystal: what is possible
  Interval delay_seen_us_;    // the same without longest_delay_us, whose one-sidedness would bias the middle
  bool delay_known_ = false;  // from TM1, else from longest_delay_us

  bool started_ = false;         // a stamp or a reply was seen in this epoch
  bool scanned_ = false;         // a scan was
  bool compared_ = false;        // two seconds of scans were
  std::int64_t origin_ns_ = 0;   // host time of host_us == 0
  std::int64_t origin_ms_ = 0;   // unwrapped device time of x == 0
  std::int64_t anchor_ms_ = 0;   // last device time, unwrapped
  double anchor_host_us_ = 0.0;  // when it came
  std::int64_t last_stamp_ms_ = 0;
  std::uint64_t index_ = 0;
  bool synchronised_ = false;    // TM1 replies in this epoch
  double synchronised_x_ = 0.0;  // x of the last one

  // The fastest scan of the present window.
  int window_scans_ = 0;
  int window_length_;
  int late_windows_ = 0;  // one after the other
  double window_late_us_ = 0.0;
  double window_x_ = 0.0;
  double window_y_ = 0.0;

  std::uint64_t lost_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint64_t contradictions_ = 0;
  std::uint32_t epoch_ = 0;
};

}  // namespace submapd::driver
