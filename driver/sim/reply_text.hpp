// The sensor's side of SCIP 2.0 on paper: sums, numbers, lines and blocks as the manual prints them.
//
// Written for the emulated sensor apart from driver/scip, so that an error in one is not repeated by the other: the
// emulator is the driver's judge.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace submapd::driver::reply {

[[nodiscard]] inline char sum_of(std::string_view text) {
  unsigned sum = 0;
  for (const char c : text) {
    sum += static_cast<unsigned char>(c);
  }
  return static_cast<char>((sum & 0x3FU) + 0x30U);
}

// n characters of 6 bits, most significant first.
inline void append_number(std::string& out, std::uint64_t value, int characters) {
  for (int i = characters - 1; i >= 0; --i) {
    out += static_cast<char>(((value >> (6 * i)) & 0x3FU) + 0x30U);
  }
}

[[nodiscard]] inline std::string line(std::string_view text) {
  return std::string(text) + sum_of(text) + '\n';
}

// KEY:value;S, where the sum leaves out the semicolon.
[[nodiscard]] inline std::string parameter(std::string_view key, std::string_view value) {
  const std::string text = std::string(key) + ':' + std::string(value);
  return text + ';' + sum_of(text) + '\n';
}

[[nodiscard]] inline std::string blocks(std::string_view data) {
  std::string out;
  out.reserve(data.size() + data.size() / 32 + 2);
  for (; !data.empty(); data.remove_prefix(data.size() < 64 ? data.size() : 64)) {
    out += line(data.substr(0, 64));
  }
  return out;
}

}  // namespace submapd::driver::reply
