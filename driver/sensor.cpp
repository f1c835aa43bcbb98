// The watch over the stream, and the sensor's ear. Its steps are in sensor_steps.cpp.
#include "driver/sensor.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace submapd::driver {
namespace {

constexpr std::int64_t kPause_ns = 5 * kMillisecond_ns;  // between two scans are some 20 ms

enum class Rung : std::uint8_t { kCount, kStartAgain, kQuit, kResetSensor, kResetUsb };
struct LadderRung {
  std::int64_t after_ns;  // since the last scan
  Rung rung;
};
constexpr std::array kLadder = {
    LadderRung{75 * kMillisecond_ns, Rung::kCount},      LadderRung{250 * kMillisecond_ns, Rung::kStartAgain},
    LadderRung{500 * kMillisecond_ns, Rung::kQuit},      LadderRung{1000 * kMillisecond_ns, Rung::kResetSensor},
    LadderRung{3000 * kMillisecond_ns, Rung::kResetUsb},
};

}  // namespace

std::string_view name(SensorState state) {
  constexpr std::array<std::string_view, 7> kNames = {"closed",    "starting",   "unassigned", "measuring clock",
                                                      "streaming", "recovering", "trouble"};
  return kNames[static_cast<std::size_t>(state)];
}

Sensor::Sensor(SensorOptions options, std::string port, SensorOwner& owner)
    : options_(options),
      port_(std::move(port)),
      owner_(owner),
      random_(options.seed),
      parser_(std::make_unique<scip::Parser>()) {
  status_.identity.port = port_;
}

SensorCounters Sensor::counters() const noexcept {
  const auto get = [](const Counter& counter) { return counter.load(std::memory_order_relaxed); };
  return {get(scans_), get(stale_scans_),   get(faults_),     get(gaps_),    get(starts_again_),
          get(quits_), get(sensor_resets_), get(usb_resets_), get(troubles_)};
}

void Sensor::tell(SensorState state, std::string words) {
  if (status_.state == state && status_.words == words) {
    return;
  }
  status_.state = state;
  status_.words = std::move(words);
  owner_.on_status(status_);
}

bool Sensor::abnormal(const scip::ReplyStatus& status) const {
  return scip::explain(asked_.text(), status).meaning == scip::StatusMeaning::kAbnormal;
}

void Sensor::on_open(ByteLink& link, std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  link_ = &link;
  parser_->reset();
  scip11_ = false;
  if (assignment_) {
    assignment_->sink->on_new_clock();
  }
  tell(SensorState::kStarting, silent_ ? status_.words : "");
  begin(Goal::kStartUp, Step::kListen);
}

void Sensor::on_close(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  link_ = nullptr;
  watching_ = false;
  step_ = Step::kClosed;
  deadline_ns_ = kNever_ns;
  tell(SensorState::kClosed, status_.words);
}

void Sensor::on_stop(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  watching_ = false;
  step_ = Step::kClosed;
  deadline_ns_ = kNever_ns;
  constexpr std::array<std::uint8_t, 3> kLaserOff = {'Q', 'T', '\n'};
  static_cast<void>(link_->write(kLaserOff));
}

void Sensor::on_bytes(std::span<const std::uint8_t> bytes, std::int64_t stamp_ns, std::uint64_t /*offset*/) noexcept {
  // After a pause, an echo at the start of a transfer begins a new scan, whatever is missing of the one before. Without
  // this, a scan cut in the middle of a line would take its successor along, whose echo ends that line.
  constexpr std::size_t kHead = 13;  // of the echo, up to the count of scans to come
  const std::string_view head = asked_.text().substr(0, kHead);
  if (step_ == Step::kStream && stamp_ns - heard_ns_ > kPause_ns && bytes.size() > kHead &&
      std::equal(head.begin(), head.end(), bytes.begin())) {
    parser_->end(stamp_ns, *this);
  }
  heard_ns_ = stamp_ns;
  now_ns_ = stamp_ns;
  if (step_ != Step::kListen) {
    parser_->feed(bytes, stamp_ns, *this);
  }
}

void Sensor::on_fault(LinkFault /*fault*/, std::int64_t now_ns) noexcept {
  // Bytes may be missing. The parser finds out by itself which scan that costs.
  now_ns_ = now_ns;
}

std::int64_t Sensor::next_time_ns() const noexcept {
  const bool more = watching_ && rung_ < kLadder.size();
  return std::min(deadline_ns_, more ? alive_ns_ + kLadder[rung_].after_ns : kNever_ns);
}

void Sensor::on_time(std::int64_t now_ns) noexcept {
  now_ns_ = now_ns;
  if (watching_ && rung_ < kLadder.size() && now_ns >= alive_ns_ + kLadder[rung_].after_ns) {
    climb();
  }
  if (now_ns >= deadline_ns_) {
    deadline_ns_ = kNever_ns;
    timed_out();
  }
}

// Scans are due and do not come: the next remedy.
void Sensor::climb() {
  switch (kLadder[rung_++].rung) {
    case Rung::kCount:
      count(gaps_);
      parser_->end(now_ns_, *this);
      return;
    case Rung::kStartAgain:
      tell(SensorState::kRecovering, "no scans; asked for them again");
      if (step_ == Step::kStream) {
        count(starts_again_);
        enter(Step::kStart, now_ns_);
      }
      return;
    case Rung::kQuit:
      count(quits_);
      begin(Goal::kRestart, Step::kQuit);
      return;
    case Rung::kResetSensor:
      tell(SensorState::kRecovering, "no scans for 1 s; the sensor is reset");
      begin(Goal::kResetSensor, Step::kQuit);
      return;
    case Rung::kResetUsb:
      reset_line("no scans for 3 s; its USB device is reset");
      return;
  }
}

void Sensor::reset_line(std::string words) {
  count(usb_resets_);
  tell(SensorState::kRecovering, std::move(words));
  watching_ = false;
  step_ = Step::kClosed;  // on_close() and on_open() follow
  deadline_ns_ = kNever_ns;
  link_->reset();
}

void Sensor::begin(Goal goal, Step first) {
  goal_ = goal;
  started_ns_ = now_ns_;
  parser_->forget();
  enter(first, now_ns_);
}

void Sensor::on_scan(const scip::ScanData& scan) noexcept {
  if (step_ == Step::kSelfTest) {
    return test_scan(static_cast<std::uint32_t>(scan.time));
  }
  if (step_ != Step::kStream && step_ != Step::kStart) {
    count(stale_scans_);
    return;
  }
  count(scans_);
  if (step_ == Step::kStart) {  // its acknowledgement was damaged
    step_ = Step::kStream;
    deadline_ns_ = kNever_ns;
  }
  alive_ns_ = now_ns_;
  rung_ = 0;
  resets_in_a_row_ = 0;
  pause_ns_ = 0;
  if (status_.state != SensorState::kStreaming) {
    tell(SensorState::kStreaming, scip11_ ? "spoke SCIP 1.1 and was switched to SCIP 2.0" : "");
  }
  assignment_->sink->on_scan(scan);
  if (time_wanted_.load(std::memory_order_relaxed) && time_wanted_.exchange(false)) {
    watching_ = false;
    samples_left_ = options_.later_samples;
    begin(Goal::kMeasureClock, Step::kQuit);
  }
}

void Sensor::on_stale_scan(const scip::ScanData& /*scan*/) noexcept {
  count(stale_scans_);
}

void Sensor::on_stream_start(const scip::Frame& /*frame*/) noexcept {
  if (step_ == Step::kStart) {
    step_ = Step::kStream;
    deadline_ns_ = kNever_ns;
  }
}

void Sensor::on_stream_status(const scip::Frame& frame) noexcept {
  const scip::StatusInfo info = scip::explain(frame.echo, frame.status);
  if (info.meaning == scip::StatusMeaning::kPaused || info.meaning == scip::StatusMeaning::kResumed) {
    alive_ns_ = now_ns_;  // it checks itself and says so
    rung_ = 0;
    return;
  }
  if (step_ == Step::kStream || step_ == Step::kStart) {
    refused(frame.echo, frame.status);
  } else if (step_ == Step::kSelfTest) {
    end_self_test();
  }
}

void Sensor::on_fault(const scip::Fault& fault) noexcept {
  if (step_ == Step::kStream) {
    count(faults_);
    if (fault.in_scan) {
      assignment_->sink->on_damaged_scan();
    }
    return;
  }
  if (step_ == Step::kSelfTest) {
    ++test_.damaged;
  }
  // In SCIP 1.1 the status is one character and has no sum.
  if (step_ == Step::kQuit && fault.fault == scip::FaultClass::kBadStatus) {
    enter(Step::kScip2, now_ns_);
  }
}

void Sensor::on_time(const scip::Frame& frame, std::uint64_t time) noexcept {
  if (step_ == Step::kTimeAsk && frame.echo == asked_.text()) {
    samples_lost_ = 0;
    assignment_->sink->on_time({asked_ns_, frame.first_byte_ns, static_cast<std::uint32_t>(time)});
    next_sample();
  }
}

void Sensor::on_reply(const scip::Frame& frame, std::span<const scip::Parameter> parameters) noexcept {
  if (deadline_ns_ != kNever_ns && frame.echo == asked_.text()) {
    answered(frame, parameters);
  }
}

}  // namespace submapd::driver
