// decode_submap() on any bytes: no crash, and what it accepts is legal and encodes to the same bytes.
#include <zlib.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <vector>

#include "slam/submap/submap_check.hpp"
#include "slam/submap/submap_codec.hpp"

namespace {

using Bytes = std::vector<std::byte>;

std::uint32_t get_u32(const Bytes& bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  return value;
}
void put_u32(Bytes& bytes, std::size_t offset, std::size_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[offset + i] = static_cast<std::byte>((value >> (8 * i)) & 0xFF);
}
std::uint32_t crc(const Bytes& bytes, std::size_t offset, std::size_t length) {
  return static_cast<std::uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data() + offset), length));
}

// Total length and checksums made right, or the fuzzer would never get past them.
void seal(Bytes& bytes) {
  if (bytes.size() < 28) return;
  put_u32(bytes, 16, bytes.size());
  put_u32(bytes, 20, 0);
  std::size_t offset = 24;
  while (bytes.size() - offset >= 20) {
    const std::size_t length = std::min<std::size_t>(get_u32(bytes, offset + 8), bytes.size() - offset - 20);
    put_u32(bytes, offset + 4, crc(bytes, offset + 16, length));
    offset += 16 + length;
  }
  put_u32(bytes, bytes.size() - 4, crc(bytes, 0, bytes.size() - 4));
}

void check(const Bytes& bytes) {
  const submapd::Expected<submapd::FinishedSubmap> submap = submapd::decode_submap(bytes);
  if (!submap) return;
  if (!submapd::check_submap(*submap).ok() || submapd::encode_submap(*submap) != bytes) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::byte> input = std::as_bytes(std::span(data, size));
  Bytes bytes(input.begin(), input.end());
  check(bytes);
  seal(bytes);
  check(bytes);
  return 0;
}
