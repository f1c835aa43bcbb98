// A sensor's crystal, its rotor and the USB between it and the host, with the truth beside what the host sees.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>

namespace submapd::driver::test {

struct SimOptions {
  double skew_ppm = 50.0;      // device seconds run faster by so much
  double warm_up_ppm = 0.0;    // the skew moves by so much ...
  double warm_up_s = 600.0;    // ... with this time constant
  double grid_us = 1000.0;     // of the USB frames
  double frame_ppm = 15.0;     // of the frames' clock against the host's
  double firmware_us = 900.0;  // last beam to the first byte's being ready
  double rotor_ppm = 300.0;    // turns are longer by so much than 25 device milliseconds
  double wander_us = 100.0;    // the rotor hunts about its mean by so much, once a minute
  double jitter_us = 20.0;     // and single turns are off that by up to so much
  double late_share = 0.05;    // packets that the host handles late
  double late_us = 3000.0;     // ... by so much on average
  double stamp_to_first_beam_us = 0.0;
  std::uint64_t first_device_ms = 123'456;
};

class SensorSim {
 public:
  struct Scan {
    std::uint32_t device_ms;
    std::int64_t first_byte_ns;
    double first_beam_us;  // the truth, host time
  };
  struct Reply {
    std::int64_t sent_ns;
    std::int64_t received_ns;
    std::uint32_t device_ms;
  };

  SensorSim(const SimOptions& options, std::uint32_t seed) : options_(options), random_(seed) {
    frame_phase_us_ = uniform(0.0, options.grid_us);
    rotor_phase_us_ = uniform(0.0, 25'000.0);
    zero_us_ = static_cast<double>(options.first_device_ms) * 1e3 + uniform(0.0, 1e3);
    turn_zero_us_ = zero_us_;
  }

  // Host time of all that follows; starts at 1000 s of uptime.
  [[nodiscard]] double now_us() const { return now_us_; }
  void rest(double us) { now_us_ += us; }

  // The next scan that ends after now. Turns that end while the sensor is in time mode are not scans.
  Scan next_scan() {
    const double sweep_us = 18'750.0;
    for (;; ++turn_) {
      const double stamped_device_us = turn_device_us(turn_) + uniform(-options_.jitter_us, options_.jitter_us);
      const double stamped_us = host_of(stamped_device_us);
      const double first_beam_us = stamped_us + options_.stamp_to_first_beam_us;
      const double end_us = first_beam_us + sweep_us;
      if (end_us < now_us_) continue;
      const double arrival_us = std::max(deliver(end_us + options_.firmware_us), last_arrival_us_);
      last_arrival_us_ = arrival_us;
      now_us_ = end_us;
      const auto device_ms = static_cast<std::uint64_t>(std::floor(stamped_device_us / 1e3));
      ++turn_;
      return {static_cast<std::uint32_t>(device_ms & 0xFFFFFF), to_ns(arrival_us), first_beam_us};
    }
  }

  // Turns that the sensor makes and does not send.
  void lose(int scans) { turn_ += scans; }

  Reply ask_time() {
    const double sent_us = now_us_;
    const double read_us = frame_after(sent_us) + uniform(30.0, 100.0);
    const double received_us = deliver(read_us + 20.0);
    now_us_ = received_us;
    const auto device_ms = static_cast<std::uint64_t>(std::floor(device_of(read_us) / 1e3));
    return {to_ns(sent_us), to_ns(received_us), static_cast<std::uint32_t>(device_ms & 0xFFFFFF)};
  }

  // The sensor's counter begins at zero again.
  void restart_clock() {
    zero_us_ -= device_of(now_us_);
    turn_zero_us_ = 0.0;
    rotor_phase_us_ = uniform(0.0, 25'000.0);
    turn_ = 0;
  }

  // Host seconds a device second less one, at a host time.
  [[nodiscard]] double true_skew_ppm(double host_us) const {
    const double s = (host_us - kStart_us) / 1e6;
    return -(options_.skew_ppm + options_.warm_up_ppm * (1.0 - std::exp(-s / options_.warm_up_s)));
  }

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

 private:
  static constexpr double kStart_us = 1e9;

  static std::int64_t to_ns(double us) { return std::llround(us * 1e3); }

  [[nodiscard]] double device_of(double host_us) const {
    const double us = host_us - kStart_us;
    const double tau_us = options_.warm_up_s * 1e6;
    const double warm = options_.warm_up_ppm * (us - tau_us * (1.0 - std::exp(-us / tau_us)));
    return zero_us_ + us + (options_.skew_ppm * us + warm) * 1e-6;
  }

  [[nodiscard]] double host_of(double device_us) const {
    double host_us = kStart_us + device_us - zero_us_;
    for (int i = 0; i < 4; ++i) host_us += device_us - device_of(host_us);
    return host_us;
  }

  [[nodiscard]] double turn_device_us(std::int64_t turn) const {
    const double nominal_us = 25'000.0 * static_cast<double>(turn);
    const double hunting = options_.wander_us * std::sin(2.0 * std::numbers::pi * nominal_us / 60e6);
    return turn_zero_us_ + rotor_phase_us_ + nominal_us * (1.0 + options_.rotor_ppm * 1e-6) + hunting;
  }

  [[nodiscard]] double frame_after(double us) const {
    const double frame_us = options_.grid_us * (1.0 + options_.frame_ppm * 1e-6);
    return std::ceil((us - frame_phase_us_) / frame_us) * frame_us + frame_phase_us_;
  }

  // When the host stamps what was ready at that time.
  double deliver(double ready_us) {
    double us = frame_after(ready_us) + uniform(20.0, 120.0);
    if (uniform(0.0, 1.0) < options_.late_share)
      us += std::exponential_distribution<double>(1.0 / options_.late_us)(random_);
    return us;
  }

  SimOptions options_;
  std::mt19937 random_;
  double now_us_ = kStart_us;
  double zero_us_ = 0.0;       // device time at kStart_us
  double turn_zero_us_ = 0.0;  // device time from which turns are counted
  double frame_phase_us_ = 0.0;
  double rotor_phase_us_ = 0.0;
  std::int64_t turn_ = 0;
  double last_arrival_us_ = 0.0;
};

}  // namespace submapd::driver::test
