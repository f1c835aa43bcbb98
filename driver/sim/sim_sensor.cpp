#include "driver/sim/sim_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace submapd::driver {
namespace {

constexpr std::uint32_t kClockMask = 0xFFFFFF;  // 24 bits

std::int64_t up_to_grid(std::int64_t time_ns, std::int64_t grid_ns) {
  return grid_ns <= 0 ? time_ns : (time_ns + grid_ns - 1) / grid_ns * grid_ns;
}

}  // namespace

std::uint64_t hash_ranges(std::span<const std::uint32_t> range_mm) {
  std::uint64_t hash = 0xCBF29CE484222325ULL;
  for (const std::uint32_t value : range_mm) {
    for (int byte = 0; byte < 4; ++byte) {
      hash = (hash ^ ((value >> (8 * byte)) & 0xFFU)) * 0x100000001B3ULL;
    }
  }
  return hash;
}

SimSensor::SimSensor(SimSensorOptions options, std::unique_ptr<RangeSource> source, TruthSink truth)
    : options_(std::move(options)),
      source_(std::move(source)),
      truth_(std::move(truth)),
      random_(options_.seed),
      range_mm_(kSteps),
      intensity_(kSteps) {
  std::stable_sort(options_.script.begin(), options_.script.end(),
                   [](const SimFault& a, const SimFault& b) { return a.at_ns < b.at_ns; });
}

void SimSensor::power_on(std::int64_t now_ns) {
  powered_ns_ = now_ns;
  clock_zero_ns_ = now_ns;
  clock_start_ms_ = options_.clock_start_ms;
  rotation_ = 0;
  state_ = State::kBooting;
  line_.clear();
  commands_.clear();
  scip11_ = options_.scip11;
  abnormal_ = options_.abnormal;
  trouble_ = false;
  reboots_asked_ = 0;
  fault_mode_ = 10;
  hang_.reset();
}

void SimSensor::restart(std::int64_t now_ns, std::int64_t dark_ns) {
  power_on(now_ns + dark_ns);
  clock_start_ms_ = 0;
  abnormal_ = false;
  ++epoch_;
}

std::uint32_t SimSensor::device_ms(std::int64_t now_ns) const {
  const double elapsed_ms = static_cast<double>(now_ns - clock_zero_ns_) * (1.0 + 1e-6 * options_.clock_ppm) * 1e-6;
  const auto whole_ms = static_cast<std::int64_t>(std::floor(elapsed_ms));
  return static_cast<std::uint32_t>(clock_start_ms_ + whole_ms) & kClockMask;
}

std::int64_t SimSensor::step0_ns(std::uint64_t rotation) const {
  const double period_ns = kScanPeriod_ns / (1.0 + 1e-6 * options_.clock_ppm);
  return powered_ns_ + options_.grid_phase_ns + std::llround(static_cast<double>(rotation) * period_ns);
}

// A turn's values are put together, and commands are looked at, after its last beam; what that gives is sent a little
// later, so that the time it takes to emulate a scan is not seen from outside.
std::int64_t SimSensor::tick_ns() const {
  return step0_ns(rotation_) + static_cast<std::int64_t>(kMeasuring_ns);
}

void SimSensor::receive(std::int64_t now_ns, std::span<const std::uint8_t> bytes) {
  run_until(now_ns);
  finish_boot(now_ns);
  if (state_ == State::kBooting || now_ns < silent_until_ns_ || now_ns < away_until_ns_) {
    return;
  }
  constexpr std::size_t kLongestCommand = 128;
  constexpr std::size_t kMostCommands = 64;  // unanswered; further ones are not heard
  for (const std::uint8_t byte : bytes) {
    if (byte != '\n' && byte != '\r') {
      if (line_.size() < kLongestCommand) {
        line_ += static_cast<char>(byte);
      }
      continue;
    }
    if (commands_.size() >= kMostCommands) {
      line_.clear();
    } else if (!line_.empty()) {
      const bool direct = state_ == State::kTimeMode;
      commands_.push_back({std::exchange(line_, {}), now_ns + (direct ? options_.time_mode_latency_ns : 0), direct});
    }
  }
}

void SimSensor::usb_reset(std::int64_t now_ns) {
  run_until(now_ns);
  outputs_.clear();
  line_.clear();
  commands_.clear();
  if (hang_ && *hang_ <= SimRemedy::kUsbReset) {
    hang_.reset();
    state_ = State::kIdle;
  }
}

std::int64_t SimSensor::next_event_ns() const {
  std::int64_t next = tick_ns();
  if (!commands_.empty() && commands_.front().direct) {
    next = std::min(next, commands_.front().ready_ns);
  }
  if (!outputs_.empty()) {
    next = std::min(next, outputs_.front().due_ns);
  }
  return next;
}

std::optional<SimOutput> SimSensor::take(std::int64_t now_ns) {
  run_until(now_ns);
  if (outputs_.empty() || outputs_.front().due_ns > now_ns) {
    return std::nullopt;
  }
  SimOutput output = std::move(outputs_.front());
  outputs_.pop_front();
  return output;
}

void SimSensor::run_until(std::int64_t now_ns) {
  for (;;) {
    const bool direct = !commands_.empty() && commands_.front().direct;
    const std::int64_t tick_at = tick_ns();
    if (direct && commands_.front().ready_ns <= std::min(now_ns, tick_at)) {
      const Command command = std::move(commands_.front());
      commands_.pop_front();
      sending_takes_ns_ = 0;
      execute(command, command.ready_ns);
    } else if (tick_at <= now_ns) {
      tick();
    } else {
      return;
    }
  }
}

void SimSensor::finish_boot(std::int64_t now_ns) {
  if (state_ == State::kBooting && now_ns >= powered_ns_ + options_.boot_ns) {
    state_ = State::kIdle;
  }
}

void SimSensor::tick() {
  const std::int64_t now_ns = tick_ns();
  sending_takes_ns_ = options_.scan_latency_ns;
  finish_boot(now_ns);
  const std::int64_t powered_before_ns = powered_ns_;
  if (state_ == State::kStreaming) {
    stream_turn(now_ns);
  }
  while (powered_ns_ == powered_before_ns && !commands_.empty()) {
    const Command command = std::move(commands_.front());
    commands_.pop_front();
    execute(command, now_ns);
  }
  if (powered_ns_ == powered_before_ns) {
    ++rotation_;
  }
}

void SimSensor::send(std::string_view message, std::int64_t now_ns) {
  send_bytes({reinterpret_cast<const std::uint8_t*>(message.data()), message.size()}, now_ns, true);
}

void SimSensor::send_bytes(std::span<const std::uint8_t> bytes, std::int64_t now_ns, bool message_end) {
  if (now_ns < silent_until_ns_ || now_ns < away_until_ns_) {
    return;
  }
  constexpr std::size_t kPacketBytes = 64;
  const std::size_t piece_bytes =
      options_.usb_frame_ns > 0 ? kPacketBytes * options_.packets_per_frame : std::max<std::size_t>(bytes.size(), 1);
  std::int64_t due_ns = std::max(up_to_grid(now_ns + sending_takes_ns_, options_.usb_frame_ns), last_due_ns_);
  while (!bytes.empty()) {
    const std::size_t length = std::min(piece_bytes, bytes.size());
    SimOutput output;
    output.due_ns = due_ns;
    output.bytes.assign(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
    bytes = bytes.subspan(length);
    output.message_end = message_end && bytes.empty();
    outputs_.push_back(std::move(output));
    last_due_ns_ = due_ns;
    due_ns += options_.usb_frame_ns;
  }
}

void SimSensor::send_event(SimOutput::Kind kind, std::int64_t due_ns) {
  SimOutput output;
  output.kind = kind;
  output.due_ns = std::max(due_ns + sending_takes_ns_, last_due_ns_);
  last_due_ns_ = output.due_ns;
  outputs_.push_back(std::move(output));
}

}  // namespace submapd::driver
