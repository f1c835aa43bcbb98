// The measuring side of the emulated sensor: scans on their grid, and what is scripted to go wrong with them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "driver/scip/encode.hpp"
#include "driver/sim/sim_sensor.hpp"

namespace submapd::driver {
namespace {

constexpr std::uint32_t kDmin_mm = 23;

// The smallest distance among neighbours; the smallest code if none of them is a distance.
std::size_t nearest(std::span<const std::uint32_t> range_mm) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < range_mm.size(); ++i) {
    const bool valid = range_mm[i] >= kDmin_mm;
    const bool best_valid = range_mm[best] >= kDmin_mm;
    if (valid != best_valid ? valid : range_mm[i] < range_mm[best]) {
      best = i;
    }
  }
  return best;
}

}  // namespace

void SimSensor::stream_turn(std::int64_t now_ns) {
  if (hang_ || ++stream_.skipped <= stream_.interval) {
    return;
  }
  const bool wide = stream_.kind == 'E' && stream_.last - stream_.first + 1 == static_cast<int>(kSteps);
  if (wide && rotation_ % options_.scans_per_me_message != 0) {
    return;
  }
  stream_.skipped = 0;
  if (stream_trouble(now_ns)) {
    return;
  }
  if (stream_.limited) {
    --stream_.remaining;
  }
  ++stream_.scans;
  if (!first_scan_ns_) {
    first_scan_ns_ = now_ns;
  }
  send_scan(fmt::format("{}{:02d}{}", stream_.head, stream_.remaining, stream_.suffix), "99", stream_, now_ns);
  if (state_ == State::kStreaming && stream_.limited && stream_.remaining == 0) {
    state_ = State::kIdle;
  }
}

// Faults that the sensor itself tells of in its stream: DB's rehearsals and scripted trouble.
bool SimSensor::stream_trouble(std::int64_t now_ns) {
  constexpr std::uint64_t kHealthyScans = 10;
  constexpr std::uint64_t kCheckedTurns = 5;
  const char* status = nullptr;
  bool ends = false;
  const bool error_first = fault_mode_ == 3 || fault_mode_ == 4;
  if (trouble_ || fault_mode_ == 2 || (fault_mode_ == 5 && stream_.scans >= kHealthyScans)) {
    status = "51";
    ends = true;
    trouble_ = true;
  } else if (error_first && stream_.scans >= kHealthyScans && stream_.scans <= kHealthyScans + kCheckedTurns) {
    ends = fault_mode_ == 4 && stream_.scans == kHealthyScans + kCheckedTurns;
    status = ends ? "51" : stream_.scans == kHealthyScans + kCheckedTurns ? "98" : "21";
    trouble_ = ends;
    ++stream_.scans;
  }
  if (status == nullptr) {
    return false;
  }
  const std::string echo = fmt::format("{}{:02d}{}", stream_.head, stream_.remaining, stream_.suffix);
  std::string reply;
  scip::append_status(reply, echo, status);
  send(reply, now_ns);
  if (ends) {
    state_ = State::kIdle;
  }
  return true;
}

void SimSensor::send_scan(const std::string& echo, const char* status, const Stream& stream, std::int64_t now_ns) {
  SimScanTruth truth;
  truth.rotation = rotation_;
  truth.epoch = epoch_;
  truth.first_beam_ns = step0_ns(rotation_);
  truth.stamp_ms = device_ms(truth.first_beam_ns - options_.stamp_to_step0_ns);
  source_->measure(rotation_, truth.first_beam_ns, range_mm_, intensity_);
  const std::uint32_t most = stream.kind == 'S' ? 4095 : 262143;
  std::vector<std::uint32_t> ranges_mm;
  std::vector<std::uint32_t> intensities;
  for (int step = stream.first; step <= stream.last; step += stream.cluster) {
    const int count = std::min(stream.cluster, stream.last - step + 1);
    const std::span<const std::uint32_t> cluster(range_mm_.data() + step, static_cast<std::size_t>(count));
    const std::size_t best = nearest(cluster);
    ranges_mm.push_back(std::min(cluster[best], most));
    if (stream.kind == 'E') {
      intensities.push_back(intensity_[static_cast<std::size_t>(step) + best]);
    }
  }
  truth.ranges_hash = hash_ranges(ranges_mm);
  scip::ScanFrame scan;
  scan.echo = echo;
  scan.status = status;
  scan.time = truth.stamp_ms;
  scan.value_characters = stream.kind == 'S' ? 2 : 3;
  scan.ranges_mm = ranges_mm;
  scan.intensities = intensities;
  std::string text;
  scip::append_scan(text, scan);
  std::vector<std::uint8_t> frame(text.begin(), text.end());
  truth.sent = now_ns >= silent_until_ns_ && now_ns >= away_until_ns_;
  apply_faults(frame, truth, now_ns);
  truth.sent_ns = last_due_ns_;
  scans_sent_ += truth.sent ? 1 : 0;
  if (truth_) {
    truth_(truth);
  }
}

void SimSensor::note(SimFaultKind kind, SimScanTruth& truth) {
  truth.faults |= 1U << static_cast<unsigned>(kind);
  ++faults_injected_[static_cast<std::size_t>(kind)];
}

// Damages, splits, doubles or drops the scan as the script says, and sends what is left of it.
void SimSensor::apply_faults(std::vector<std::uint8_t>& frame, SimScanTruth& truth, std::int64_t now_ns) {
  const std::int64_t script_ns = now_ns - first_scan_ns_.value_or(now_ns);
  std::optional<SimFault> event;
  while (next_fault_ < options_.script.size() && options_.script[next_fault_].at_ns <= script_ns && !event) {
    const SimFault& fault = options_.script[next_fault_++];
    const bool scans =
        damages_bytes(fault.kind) || fault.kind == SimFaultKind::kSkip || fault.kind == SimFaultKind::kRepeat;
    if (scans) {
      damaging_.push_back(fault);
    } else {
      event = fault;
    }
  }
  bool repeat = false;
  for (SimFault& fault : damaging_) {
    --fault.count;
    note(fault.kind, truth);
    if (damages_bytes(fault.kind)) {
      damage_frame(fault.kind, random_, frame);
    } else if (fault.kind == SimFaultKind::kSkip) {
      truth.sent = false;
    } else {
      repeat = true;
    }
  }
  std::erase_if(damaging_, [](const SimFault& fault) { return fault.count == 0; });

  const auto chance = [this](double rate) { return static_cast<double>(random_() >> 11) * 0x1.0p-53 < rate; };
  if (truth.faults == 0 && options_.fault_rate > 0.0 && chance(options_.fault_rate)) {
    constexpr std::array kDetectable = {
        SimFaultKind::kGarbledSum,    SimFaultKind::kBadCharacter, SimFaultKind::kLostPacket, SimFaultKind::kLostLine,
        SimFaultKind::kDoubledPacket, SimFaultKind::kDoubledLine,  SimFaultKind::kCut,        SimFaultKind::kGarbage};
    const SimFaultKind kind = kDetectable[random_() % kDetectable.size()];
    note(kind, truth);
    damage_frame(kind, random_, frame);
  } else if (truth.faults == 0 && options_.damage_rate > 0.0 && chance(options_.damage_rate)) {
    note(SimFaultKind::kDamagedBytes, truth);
    damage_frame(SimFaultKind::kDamagedBytes, random_, frame);
  }
  if (!truth.sent) {
    return;
  }
  if (!event) {
    send_bytes(frame, now_ns, true);
    if (repeat) {
      send_bytes(frame, now_ns, true);
    }
    return;
  }
  const std::span<const std::uint8_t> whole(frame);
  const std::size_t half = frame.size() / 2;
  const bool on_bus = event->kind >= SimFaultKind::kStall && event->kind <= SimFaultKind::kPowerCycle;
  if (on_bus) {
    send_bytes(whole.first(half), now_ns, false);
    begin_fault(*event, truth, now_ns);
    send_bytes(whole.subspan(half), now_ns, true);
  } else {
    begin_fault(*event, truth, now_ns);
  }
}

void SimSensor::begin_fault(const SimFault& fault, SimScanTruth& truth, std::int64_t now_ns) {
  note(fault.kind, truth);
  switch (fault.kind) {
    case SimFaultKind::kStall:
      send_event(SimOutput::Kind::kStall, now_ns);
      return;
    case SimFaultKind::kOverflow:
      send_event(SimOutput::Kind::kOverflow, now_ns);
      return;
    case SimFaultKind::kUnplug:
    case SimFaultKind::kPowerCycle:
      send_event(SimOutput::Kind::kUnplug, now_ns);
      away_until_ns_ = now_ns + fault.duration_ns;
      send_event(SimOutput::Kind::kReplug, away_until_ns_);
      if (fault.kind == SimFaultKind::kPowerCycle) {
        restart(now_ns, fault.duration_ns);
      }
      return;
    case SimFaultKind::kSilence:
      silent_until_ns_ = now_ns + fault.duration_ns;
      break;
    case SimFaultKind::kHang:
      hang_ = fault.remedy;
      break;
    case SimFaultKind::kBrownOut:
      restart(now_ns, 0);
      break;
    case SimFaultKind::kAbnormal:
      abnormal_ = true;
      state_ = State::kIdle;
      break;
    case SimFaultKind::kTrouble:
      trouble_ = true;  // the next turn tells of it
      break;
    default:
      break;
  }
  truth.sent = false;
}

}  // namespace submapd::driver
