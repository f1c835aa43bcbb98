// SCIP 2.0's number code and checksum: 6 bits a character, offset 0x30.
//
// Pure functions, any thread, no allocation. Source: SCIP 2.0 specification C-42-03320B, sections 2 and 3.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace submapd::driver::scip {

inline constexpr unsigned kCodeOffset = 0x30;  // character of the value 0
inline constexpr unsigned kCodeMask = 0x3F;    // bits of one character
inline constexpr unsigned kCodeBits = 6;
inline constexpr std::size_t kBlock = 64;                      // data characters of a full line, without its sum
inline constexpr std::size_t kTimeCharacters = 4;              // 24-bit milliseconds
inline constexpr std::size_t kMicrosecondTimeCharacters = 11;  // '%' commands: 64-bit microseconds

// True for 0x30..0x6F, the characters that code a value. The sum of a line cannot see errors that are a multiple of 64,
// e.g. a flipped bit 6 or 7; this check does.
[[nodiscard]] constexpr bool is_code(char c) {
  return static_cast<unsigned char>(static_cast<unsigned char>(c) - kCodeOffset) <= kCodeMask;
}

[[nodiscard]] constexpr bool is_printable(char c) {
  return c >= 0x20 && c <= 0x7E;
}

// Sum character of a line: the bytes before it modulo 64, plus 0x30.
[[nodiscard]] constexpr char checksum(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) sum += static_cast<unsigned char>(c);
  return static_cast<char>((sum & kCodeMask) + kCodeOffset);
}

// Value of up to 11 characters, most significant first. REQUIRES: is_code() of each.
[[nodiscard]] constexpr std::uint64_t decode(std::string_view characters) {
  std::uint64_t value = 0;
  for (const char c : characters) value = (value << kCodeBits) | (static_cast<unsigned char>(c) - kCodeOffset);
  return value;
}

// Calls put(character) for `characters` characters of value, most significant first; higher bits of value are lost.
template <typename Put>
constexpr void encode(std::uint64_t value, std::size_t characters, Put&& put) {
  for (std::size_t i = characters; i-- > 0;) {
    put(static_cast<char>(((value >> (kCodeBits * i)) & kCodeMask) + kCodeOffset));
  }
}

}  // namespace submapd::driver::scip
