#include "driver/sim/fault_script.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace submapd::driver {
namespace {

enum class Argument : std::uint8_t { kNone, kCount, kSeconds, kRemedy };

struct Entry {
  std::string_view name;
  SimFaultKind kind;
  Argument argument;
  double default_s = 0.0;
};

constexpr std::array kEntries = {
    Entry{"garbled-sum", SimFaultKind::kGarbledSum, Argument::kCount},
    Entry{"bad-character", SimFaultKind::kBadCharacter, Argument::kCount},
    Entry{"damaged-bytes", SimFaultKind::kDamagedBytes, Argument::kCount},
    Entry{"lost-packet", SimFaultKind::kLostPacket, Argument::kCount},
    Entry{"lost-line", SimFaultKind::kLostLine, Argument::kCount},
    Entry{"doubled-packet", SimFaultKind::kDoubledPacket, Argument::kCount},
    Entry{"doubled-line", SimFaultKind::kDoubledLine, Argument::kCount},
    Entry{"cut", SimFaultKind::kCut, Argument::kCount},
    Entry{"garbage", SimFaultKind::kGarbage, Argument::kCount},
    Entry{"stall", SimFaultKind::kStall, Argument::kNone},
    Entry{"overflow", SimFaultKind::kOverflow, Argument::kNone},
    Entry{"unplug", SimFaultKind::kUnplug, Argument::kSeconds, 0.5},
    Entry{"power-cycle", SimFaultKind::kPowerCycle, Argument::kSeconds, 0.5},
    Entry{"silence", SimFaultKind::kSilence, Argument::kSeconds, 0.1},
    Entry{"skip", SimFaultKind::kSkip, Argument::kCount},
    Entry{"repeat", SimFaultKind::kRepeat, Argument::kCount},
    Entry{"hang", SimFaultKind::kHang, Argument::kRemedy},
    Entry{"brown-out", SimFaultKind::kBrownOut, Argument::kNone},
    Entry{"abnormal", SimFaultKind::kAbnormal, Argument::kNone},
    Entry{"trouble", SimFaultKind::kTrouble, Argument::kNone},
};

constexpr std::array<std::string_view, 5> kRemedies = {"md", "qt", "rs", "reset", "power"};

bool parse_seconds(std::string_view text, std::int64_t& out_ns) {
  double seconds = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc() || end != text.data() + text.size() || !(seconds >= 0.0) || seconds > 1e6) {
    return false;
  }
  out_ns = std::llround(seconds * 1e9);
  return true;
}

bool parse_argument(Argument kind, std::string_view text, SimFault& fault) {
  switch (kind) {
    case Argument::kNone:
      return false;
    case Argument::kSeconds:
      return parse_seconds(text, fault.duration_ns);
    case Argument::kCount: {
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), fault.count);
      return error == std::errc() && end == text.data() + text.size() && fault.count > 0;
    }
    case Argument::kRemedy: {
      const auto* const found = std::find(kRemedies.begin(), kRemedies.end(), text);
      fault.remedy = static_cast<SimRemedy>(found - kRemedies.begin());
      return found != kRemedies.end();
    }
  }
  return false;
}

std::string allowed_kinds() {
  std::string all;
  for (const Entry& entry : kEntries) {
    all += all.empty() ? "" : ", ";
    all += entry.name;
  }
  return all;
}

constexpr std::size_t kPacket = 64;
constexpr std::size_t kFullLine = 66;  // 64 characters, sum, LF

struct Damage {
  std::mt19937_64& random;
  std::vector<std::uint8_t>& frame;
  std::size_t data;   // where the first data line begins
  std::size_t lines;  // complete data lines

  std::size_t below(std::size_t n) { return static_cast<std::size_t>(random() % n); }
  std::size_t line() { return data + kFullLine * below(lines); }
  std::size_t packet() { return kPacket * (1 + below(frame.size() / kPacket - 1)); }
  auto at(std::size_t offset) { return frame.begin() + static_cast<std::ptrdiff_t>(offset); }

  void replace_inside_alphabet(std::size_t offset) {
    const auto other = static_cast<std::uint8_t>(0x30 + (frame[offset] - 0x30U + 1 + below(63)) % 64);
    frame[offset] = other;
  }
  void repeat(std::size_t offset, std::size_t length) {
    const std::vector<std::uint8_t> piece(at(offset), at(offset + length));
    frame.insert(at(offset), piece.begin(), piece.end());
  }
};

}  // namespace

tl::expected<SimFault, std::string> parse_sim_fault(std::string_view text) {
  const std::string all(text);
  const std::size_t at = text.find('@');
  const std::string_view name = text.substr(0, at);
  const auto* const entry =
      std::find_if(kEntries.begin(), kEntries.end(), [name](const Entry& e) { return e.name == name; });
  if (entry == kEntries.end()) {
    return tl::unexpected("fault \"" + all + "\": knows no such kind; there are " + allowed_kinds());
  }
  SimFault fault;
  fault.kind = entry->kind;
  fault.duration_ns = std::llround(entry->default_s * 1e9);
  const std::string_view rest = at == std::string_view::npos ? std::string_view() : text.substr(at + 1);
  const std::size_t colon = rest.find(':');
  if (!parse_seconds(rest.substr(0, colon), fault.at_ns)) {
    return tl::unexpected("fault \"" + all + "\": wants KIND@SECONDS[:ARGUMENT], the seconds since the first scan");
  }
  if (colon != std::string_view::npos && !parse_argument(entry->argument, rest.substr(colon + 1), fault)) {
    return tl::unexpected("fault \"" + all + "\": this argument is not allowed; see hokuyo-sim --help");
  }
  return fault;
}

std::string_view name_of(SimFaultKind kind) {
  return kEntries[static_cast<std::size_t>(kind)].name;
}

bool damages_bytes(SimFaultKind kind) {
  return kind <= SimFaultKind::kGarbage;
}

void damage_frame(SimFaultKind kind, std::mt19937_64& random, std::vector<std::uint8_t>& frame) {
  std::size_t data = 0;
  for (int line = 0; line < 3; ++line) {  // echo, status, time
    data = static_cast<std::size_t>(std::find(frame.begin() + static_cast<std::ptrdiff_t>(data), frame.end(), '\n') -
                                    frame.begin() + 1);
  }
  Damage damage{random, frame, data, (frame.size() - data) / kFullLine};
  switch (kind) {
    case SimFaultKind::kGarbledSum:
      damage.replace_inside_alphabet(damage.line() + 64);
      break;
    case SimFaultKind::kBadCharacter:
      frame[damage.line() + damage.below(64)] |= 0x80;
      break;
    case SimFaultKind::kDamagedBytes: {
      const std::size_t line = damage.line();
      const std::size_t first = damage.below(64);
      damage.replace_inside_alphabet(line + first);
      damage.replace_inside_alphabet(line + (first + 1 + damage.below(63)) % 64);
      break;
    }
    case SimFaultKind::kLostPacket: {
      const std::size_t packet = damage.packet();
      frame.erase(damage.at(packet), damage.at(packet + kPacket));
      break;
    }
    case SimFaultKind::kLostLine: {
      const std::size_t line = damage.line();
      frame.erase(damage.at(line), damage.at(line + kFullLine));
      break;
    }
    case SimFaultKind::kDoubledPacket:
      damage.repeat(damage.packet(), kPacket);
      break;
    case SimFaultKind::kDoubledLine:
      damage.repeat(damage.line(), kFullLine);
      break;
    case SimFaultKind::kCut:
      frame.resize(damage.line() + damage.below(64));
      break;
    case SimFaultKind::kGarbage: {
      std::vector<std::uint8_t> noise(100);
      for (std::uint8_t& byte : noise) {
        byte = static_cast<std::uint8_t>(random());
      }
      frame.insert(frame.begin(), noise.begin(), noise.end());
      break;
    }
    default:
      break;
  }
}

}  // namespace submapd::driver
