// Writes what a SCIP 2.0 sensor sends: whole replies with their sums, for the emulated scanner and the tests.
//
// Each function appends one complete frame, echo to blank line, to the caller's string; it allocates only if that has
// too little capacity. Any thread. Nothing is checked: an emulator must also be able to send nonsense.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "driver/scip/code.hpp"

namespace submapd::driver::scip {

// One line KEY:value of the answer to VV, PP or II. Views: the text must outlive the value.
struct Parameter {
  std::string_view key;
  std::string_view value;
  friend bool operator==(const Parameter&, const Parameter&) = default;
};

// One scan of M*, G* (one echo a beam) or N*, H* (several).
struct ScanFrame {
  std::string_view echo = {};      // the command; in a stream with the scans still to come as its number
  std::string_view status = "99";  // 99 in streams, 00 for G* and H*
  std::uint64_t time = 0;          // milliseconds; microseconds with kMicrosecondTimeCharacters
  std::size_t time_characters = kTimeCharacters;
  std::size_t value_characters = 3;               // 2 for *S
  std::span<const std::uint32_t> ranges_mm = {};  // raw values, error codes included; all echoes of all beams in order
  std::span<const std::uint32_t> intensities = {};  // as ranges_mm, or empty
  std::span<const std::uint8_t> echo_counts = {};   // echoes of each beam for N*, H*; empty: one each
};

// text, its sum, line feed.
void append_line(std::string& out, std::string_view text);

// A reply that is only a status; also the acknowledgement 00 of a stream.
void append_status(std::string& out, std::string_view echo, std::string_view status);

// VV, PP, II.
void append_parameters(std::string& out, std::string_view echo, std::span<const Parameter> parameters,
                       std::string_view status = "00");

// TM1, %TM1.
void append_time(std::string& out, std::string_view echo, std::uint64_t time, std::size_t characters = kTimeCharacters);

void append_scan(std::string& out, const ScanFrame& frame);

// Bytes of an append_scan() with one echo a beam, to reserve them.
[[nodiscard]] std::size_t scan_bytes(std::size_t echo_characters, std::size_t data_characters,
                                     std::size_t time_characters = kTimeCharacters);

}  // namespace submapd::driver::scip
