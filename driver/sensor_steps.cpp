// The sequences of commands: start-up, restart, reset, and the measuring of the clock.
#include <algorithm>
#include <charconv>
#include <string>
#include <utility>

#include "driver/sensor.hpp"

namespace submapd::driver {
namespace {

constexpr std::int64_t kSecond_ns = 1000 * kMillisecond_ns;
// Outside time mode replies come on the 25 ms scan grid, so nothing below 100 ms tells anything.
constexpr std::int64_t kReply_ns = 300 * kMillisecond_ns;
constexpr std::int64_t kQuitReply_ns = 150 * kMillisecond_ns;
constexpr std::int64_t kTimeReply_ns = 200 * kMillisecond_ns;
constexpr std::int64_t kListen_ns = 100 * kMillisecond_ns;
constexpr std::int64_t kPatience_ns = 15 * kSecond_ns;       // after power-on the motor spins up first
constexpr std::int64_t kLaserPatience_ns = 10 * kSecond_ns;  // BM is refused meanwhile
constexpr std::int64_t kLongestPause_ns = 10 * kSecond_ns;
constexpr std::int64_t kSelfTest_ns = 6 * kSecond_ns;  // twice what it takes, and some
constexpr int kTries = 3;

std::string_view value_of(std::span<const scip::Parameter> parameters, std::string_view key) {
  const auto found =
      std::find_if(parameters.begin(), parameters.end(), [key](const scip::Parameter& p) { return p.key == key; });
  return found == parameters.end() ? std::string_view() : found->value;
}

void read_step(std::string_view digits, int& out) {
  int value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc() && end == digits.data() + digits.size() && value >= 0 && value < 10000) {
    out = value;
  }
}

bool may_be_rebooted(std::string_view product) {
  return product.find("UST") != product.npos || product.find("-EW") != product.npos;
}

}  // namespace

void Sensor::ask(std::string_view command, std::int64_t timeout_ns) {
  // The string comes back with the answer: a late answer to an older question is not taken for this one's.
  constexpr std::string_view kHex = "0123456789abcdef";
  tag_ = (tag_ + 1) % 256;
  const std::string text = std::string(command) + ';' + kHex[tag_ / 16] + kHex[tag_ % 16];
  const auto parsed = scip::Command::parse(command == "SCIP2.0" ? command : std::string_view(text));
  asked_ = *parsed;
  asked_ns_ = now_ns_;
  deadline_ns_ = now_ns_ + timeout_ns;
  parser_->forget();  // one question at a time
  parser_->expect(asked_);
  const std::string line = std::string(asked_.text()) + '\n';
  // If it cannot be sent there is no answer, and the time runs out.
  static_cast<void>(link_->write({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()}));
}

void Sensor::ask_scans(char data, std::int64_t timeout_ns) {
  scip::ScanRequest request;
  request.data = data;
  request.first_step = first_step_;
  request.last_step = last_step_;
  request.cluster = 0;
  ask(scip::Command::scan(request).text(), timeout_ns);
}

void Sensor::enter(Step step, std::int64_t now_ns) {
  tries_ = step == step_ ? tries_ + 1 : 1;
  step_ = step;
  switch (step) {
    case Step::kListen:
      watching_ = false;
      deadline_ns_ = now_ns + kListen_ns;
      return;
    case Step::kQuit:
    case Step::kQuitAgain:
      return ask("QT", kQuitReply_ns);
    case Step::kScip2:
      return ask("SCIP2.0", kReply_ns);
    case Step::kTimeOff:
    case Step::kTimeEnd:
      return ask("TM2", kQuitReply_ns);
    case Step::kVersion:
      return ask("VV", kReply_ns);
    case Step::kParameters:
      return ask("PP", kReply_ns);
    case Step::kHealth:
      return ask("II", kReply_ns);
    case Step::kReset:
      return ask("RS", kReply_ns);
    case Step::kReboot:
      return ask("RB", kReply_ns);
    case Step::kTimeOn:
      return ask("TM0", kReply_ns);
    case Step::kTimeAsk:
      return ask("TM1", kTimeReply_ns);
    case Step::kTimePause:
      // Random, so that the requests do not keep step with the sensor's millisecond.
      deadline_ns_ = now_ns + static_cast<std::int64_t>(5'000'000 + random_() % 30'000'000);
      return;
    case Step::kLaser:
      return ask("BM", kReply_ns);
    case Step::kStart: {
      if (!watching_) {
        watching_ = true;
        alive_ns_ = now_ns;
        rung_ = 0;
      }
      return ask_scans(assignment_->intensity ? 'E' : 'D', kReply_ns);
    }
    case Step::kSelfTest:
      tell(SensorState::kStarting, "tests itself: scans with intensities");
      test_ = {};
      return ask_scans('E', kSelfTest_ns);
    case Step::kWait:
      watching_ = false;
      pause_ns_ = std::clamp(2 * pause_ns_, kSecond_ns, kLongestPause_ns);
      deadline_ns_ = now_ns + pause_ns_;
      return;
    case Step::kClosed:
    case Step::kStream:
    case Step::kIdle:
      deadline_ns_ = kNever_ns;
      return;
  }
}

void Sensor::timed_out() {
  switch (step_) {
    case Step::kListen: {
      const std::uint8_t end_of_line = '\n';  // ends half a command of an earlier program
      static_cast<void>(link_->write({&end_of_line, 1}));
      return enter(Step::kQuit, now_ns_);
    }
    case Step::kQuit:
    case Step::kQuitAgain:
    case Step::kScip2:
      if (!watching_ && now_ns_ - started_ns_ >= kPatience_ns) {
        silent_ = true;
        return reset_line("does not answer: no SCIP sensor, or it needs its power switched off and on");
      }
      // One that hangs may still hear RS.
      return enter(goal_ == Goal::kResetSensor ? Step::kTimeOff : Step::kQuit, now_ns_);
    case Step::kTimeOff:
      return goal_ == Goal::kResetSensor ? after_quit() : enter(Step::kQuitAgain, now_ns_);
    case Step::kTimeAsk:
      return ++samples_lost_ < kTries ? next_sample() : enter(Step::kTimeEnd, now_ns_);
    case Step::kTimePause:
      return enter(Step::kTimeAsk, now_ns_);
    case Step::kTimeOn:
    case Step::kTimeEnd:
      return tries_ < kTries ? enter(step_, now_ns_) : enter(Step::kLaser, now_ns_);
    case Step::kSelfTest:
      return end_self_test();
    case Step::kReset:
      return enter(Step::kQuit, now_ns_);
    case Step::kReboot:
    case Step::kWait:
      return begin(Goal::kStartUp, Step::kQuit);
    case Step::kStart:
      // The watch over the stream goes on counting from the last scan.
      return tries_ < kTries ? enter(step_, now_ns_) : enter(Step::kStream, now_ns_);
    case Step::kVersion:
    case Step::kParameters:
    case Step::kHealth:
    case Step::kLaser:
      return tries_ < kTries ? enter(step_, now_ns_) : enter(Step::kQuit, now_ns_);
    default:
      return;
  }
}

void Sensor::answered(const scip::Frame& frame, std::span<const scip::Parameter> parameters) {
  deadline_ns_ = kNever_ns;
  const bool question = step_ == Step::kVersion || step_ == Step::kParameters || step_ == Step::kHealth;
  if (question && !(frame.status == "00")) {
    return refused(frame.echo, frame.status);
  }
  switch (step_) {
    case Step::kScip2:
      scip11_ = frame.status == "0";
      return enter(Step::kQuit, now_ns_);
    case Step::kQuit:
      // Whatever it says, it hears us. In the abnormal state it still tells who it is.
      if (abnormal(frame.status)) {
        return goal_ == Goal::kStartUp ? enter(Step::kVersion, now_ns_) : refused(frame.echo, frame.status);
      }
      return enter(Step::kTimeOff, now_ns_);
    case Step::kTimeOff:
      return enter(Step::kQuitAgain, now_ns_);
    case Step::kQuitAgain:
      return after_quit();
    case Step::kVersion:
      take_identity(parameters);
      return enter(Step::kParameters, now_ns_);
    case Step::kParameters:
      read_step(value_of(parameters, "AMIN"), first_step_);
      read_step(value_of(parameters, "AMAX"), last_step_);
      return enter(Step::kHealth, now_ns_);
    case Step::kHealth:
      return answered_health(parameters);
    case Step::kReset:
      if (!(frame.status == "00")) {
        return refused(frame.echo, frame.status);
      }
      if (assignment_) {
        assignment_->sink->on_new_clock();
      }
      return enter(assignment_ ? Step::kStart : Step::kVersion, now_ns_);
    case Step::kReboot:
      // 01 asks for the second one; what follows the second is a sensor that boots.
      return frame.status == "01" && tries_ < 2 ? enter(Step::kReboot, now_ns_) : enter(Step::kWait, now_ns_);
    case Step::kTimeOn: {
      const auto meaning = scip::explain(frame.echo, frame.status).meaning;
      const bool on = meaning == scip::StatusMeaning::kOk || meaning == scip::StatusMeaning::kAlready;
      return enter(on ? Step::kTimeAsk : Step::kLaser, now_ns_);
    }
    case Step::kTimeAsk:  // a refusal: the times come by on_time()
    case Step::kTimeEnd:
      return enter(step_ == Step::kTimeAsk ? Step::kTimeEnd : Step::kLaser, now_ns_);
    case Step::kSelfTest:  // a refusal
      return end_self_test();
    case Step::kLaser:
      return answered_laser(frame.status);
    case Step::kStart:
      return refused(frame.echo, frame.status);
    default:
      return;
  }
}

void Sensor::after_quit() {
  switch (goal_) {
    case Goal::kStartUp:
      return enter(Step::kVersion, now_ns_);
    case Goal::kRestart:
      return enter(Step::kStart, now_ns_);
    case Goal::kResetSensor:
      count(sensor_resets_);
      return enter(Step::kReset, now_ns_);
    case Goal::kMeasureClock:
      tell(SensorState::kSyncing, "");
      return enter(Step::kTimeOn, now_ns_);
  }
}

void Sensor::take_identity(std::span<const scip::Parameter> parameters) {
  silent_ = false;
  status_.identity = {std::string(value_of(parameters, "SERI")), std::string(value_of(parameters, "PROD")),
                      std::string(value_of(parameters, "FIRM")), port_};
}

void Sensor::answered_health(std::span<const scip::Parameter> parameters) {
  const std::string_view words = value_of(parameters, "STAT");
  if (scip::health_of(words) != scip::Health::kTrouble) {
    return after_health();
  }
  count(troubles_);
  if (++resets_in_a_row_ <= 1) {
    tell(SensorState::kRecovering, "the sensor says \"" + std::string(words) + "\"; it is reset");
    return enter(Step::kReset, now_ns_);
  }
  trouble("the sensor says \"" + std::string(words) + "\", also after a reset; switch its power off and on");
}

void Sensor::after_health() {
  if (!assignment_) {
    auto assignment = owner_.assign(status_.identity);
    if (!assignment) {
      tell(SensorState::kUnassigned, std::move(assignment.error().message));
      return enter(Step::kIdle, now_ns_);
    }
    assignment_ = *assignment;
    if (assignment_->sink->knows_clock()) {
      assignment_->sink->on_new_clock();  // of the same scanner, which was away and may have been without power
    }
  }
  if (assignment_->self_test && !status_.self_test) {
    return enter(Step::kSelfTest, now_ns_);
  }
  if (assignment_->sink->knows_clock()) {
    return enter(Step::kLaser, now_ns_);
  }
  samples_left_ = options_.first_samples;
  tell(SensorState::kSyncing, "");
  enter(samples_left_ > 0 ? Step::kTimeOn : Step::kLaser, now_ns_);
}

void Sensor::test_scan(std::uint32_t stamp_ms) {
  constexpr std::uint32_t kTurn_ms = 25;
  constexpr std::uint32_t kClockMask = 0xFFFFFF;
  if (test_.scans > 0) {
    const std::uint32_t turns = (((stamp_ms - test_stamp_ms_) & kClockMask) + kTurn_ms / 2) / kTurn_ms;
    test_.lost += std::max(static_cast<int>(turns), 1) - 1;
  }
  test_stamp_ms_ = stamp_ms;
  if (++test_.scans == SelfTest::kScans) {
    end_self_test();
  }
}

// Passed or not, it goes on with what start-up does next; if the test has hung it, with the patience of start-up.
void Sensor::end_self_test() {
  status_.self_test = test_;
  tell(SensorState::kStarting, "");
  begin(Goal::kStartUp, Step::kQuit);
}

void Sensor::next_sample() {
  enter(--samples_left_ > 0 ? Step::kTimePause : Step::kTimeEnd, now_ns_);
}

void Sensor::answered_laser(const scip::ReplyStatus& status) {
  const auto meaning = scip::explain("BM", status).meaning;
  if (meaning == scip::StatusMeaning::kOk || meaning == scip::StatusMeaning::kAlready) {
    laser_since_ns_ = 0;
    return enter(Step::kStart, now_ns_);
  }
  if (laser_since_ns_ == 0) {
    laser_since_ns_ = now_ns_;
  }
  if (meaning == scip::StatusMeaning::kAbnormal || now_ns_ - laser_since_ns_ > kLaserPatience_ns) {
    laser_since_ns_ = 0;
    return refused("BM", status);
  }
  tries_ = 0;
  deadline_ns_ = now_ns_ + kReply_ns;  // asked again then
}

// A command that must work was answered by a status that says no.
void Sensor::refused(std::string_view command, const scip::ReplyStatus& status) {
  count(troubles_);
  const scip::StatusInfo info = scip::explain(command, status);
  const std::string words = "answers " + std::string(command.substr(0, 2)) + " with " + std::string(status.text()) +
                            ": " + std::string(info.words);
  watching_ = false;
  if (info.meaning == scip::StatusMeaning::kAbnormal) {
    trouble(words + "; switch its power off and on");
    if (may_be_rebooted(status_.identity.product) && resets_in_a_row_++ == 0) {
      enter(Step::kReboot, now_ns_);
    }
    return;
  }
  if (++resets_in_a_row_ <= 1) {
    tell(SensorState::kRecovering, words + "; it is reset");
    return begin(Goal::kResetSensor, Step::kQuit);
  }
  trouble(words + ", also after a reset; switch its power off and on");
}

void Sensor::trouble(std::string words) {
  tell(SensorState::kTrouble, std::move(words));
  enter(Step::kWait, now_ns_);
}

}  // namespace submapd::driver
