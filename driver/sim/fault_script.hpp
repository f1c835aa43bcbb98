// Scripted misbehaviour of an emulated scanner: what goes wrong, when, and for how long.
//
// Written as KIND@SECONDS[:ARGUMENT], e.g. "silence@2.5:0.4". Seconds count from the first scan sent, so that a script
// does not depend on how long the host takes to start. Damage to a scan hits the first scan sent at or after that time.
#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace submapd::driver {

enum class SimFaultKind : std::uint8_t {
  // Damage to the bytes of one scan; the argument is the number of scans (default 1).
  kGarbledSum,     // one sum character is wrong
  kBadCharacter,   // one data byte gets bit 7
  kDamagedBytes,   // two bytes of one line change inside the alphabet: one in 64 passes the sum
  kLostPacket,     // 64 bytes missing
  kLostLine,       // 66 bytes, a data line, missing: every sum stays right
  kDoubledPacket,  // 64 bytes twice
  kDoubledLine,    // a data line twice
  kCut,            // the scan ends in the middle, without its blank line
  kGarbage,        // 100 random bytes before the scan
  // What the bus does, in the middle of a scan. The argument of the unplugging ones is the time away in s (default
  // 0.5).
  kStall,
  kOverflow,
  kUnplug,      // the cable: the sensor keeps its power, its state and its clock
  kPowerCycle,  // the 12 V: gone from the bus, then starts anew
  // What the sensor does.
  kSilence,   // sends nothing and hears nothing for ARGUMENT s (default 0.1)
  kSkip,      // ARGUMENT scans are not sent (default 1)
  kRepeat,    // ARGUMENT scans are sent twice (default 1)
  kHang,      // no scans until the remedy: ARGUMENT is md, qt, rs, reset or power
  kBrownOut,  // restarts without leaving the bus: boots, clock at zero
  kAbnormal,  // status 0L to everything; RB twice or the power help
  kTrouble,   // the stream ends with status 51, STAT says trouble, RS helps
};

// What frees a sensor that hangs; each one includes those after it.
enum class SimRemedy : std::uint8_t { kMd, kQt, kRs, kUsbReset, kPower };

struct SimFault {
  SimFaultKind kind = SimFaultKind::kSilence;
  std::int64_t at_ns = 0;        // since the first scan sent
  std::int64_t duration_ns = 0;  // of silence or absence
  std::uint32_t count = 1;       // scans hit
  SimRemedy remedy = SimRemedy::kMd;
};

// One fault, or what is wrong with the text and what is allowed.
[[nodiscard]] tl::expected<SimFault, std::string> parse_sim_fault(std::string_view text);
[[nodiscard]] std::string_view name_of(SimFaultKind kind);
// True for faults that change the bytes of a scan and nothing else.
[[nodiscard]] bool damages_bytes(SimFaultKind kind);

// Damages the complete frame of one scan in place as `kind` says. REQUIRES: damages_bytes(kind) and at least four lines
// of data in the frame.
void damage_frame(SimFaultKind kind, std::mt19937_64& random, std::vector<std::uint8_t>& frame);

}  // namespace submapd::driver
