// The client's side of USB/IP as bytes, for tests of the emulator's front.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <string_view>
#include <vector>

namespace submapd::tools::test {

using Bytes = std::vector<std::uint8_t>;
using Setup = std::array<std::uint8_t, 8>;

inline void put32(Bytes& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) {
    out.push_back(static_cast<std::uint8_t>(value >> shift));
  }
}

inline Bytes ask_devlist() {
  return {0x01, 0x11, 0x80, 0x05, 0, 0, 0, 0};
}

inline Bytes ask_import(std::string_view busid) {
  Bytes out = {0x01, 0x11, 0x80, 0x03, 0, 0, 0, 0};
  out.insert(out.end(), busid.begin(), busid.end());
  out.resize(40);
  return out;
}

constexpr std::uint32_t kDevid = 1U << 16 | 2U;

// The head of a CMD_SUBMIT.
inline Bytes submit(std::uint32_t seqnum, bool in, std::uint32_t endpoint, std::uint32_t length,
                    const Setup& setup = {}) {
  Bytes out;
  for (const std::uint32_t word : {1U, seqnum, kDevid, in ? 1U : 0U, endpoint, 0U, length, 0U, 0U, 0U}) {
    put32(out, word);
  }
  out.insert(out.end(), setup.begin(), setup.end());
  return out;
}

inline Bytes submit_out(std::uint32_t seqnum, std::uint32_t endpoint, std::string_view data, const Setup& setup = {}) {
  Bytes out = submit(seqnum, false, endpoint, static_cast<std::uint32_t>(data.size()), setup);
  out.insert(out.end(), data.begin(), data.end());
  return out;
}

inline Bytes unlink(std::uint32_t seqnum, std::uint32_t unlinked) {
  Bytes out;
  for (const std::uint32_t word : {2U, seqnum, kDevid, 0U, 0U, unlinked}) {
    put32(out, word);
  }
  out.resize(48);
  return out;
}

}  // namespace submapd::tools::test
