#include "slam/base/ids.hpp"

#include <fmt/format.h>

#include "slam/base/random.hpp"

namespace submapd {

std::string Uuid::to_string() const {
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (i == 4 || i == 6 || i == 8 || i == 10) text += '-';
    text += fmt::format("{:02x}", bytes[i]);
  }
  return text;
}

Uuid Uuid::from_seed(std::uint64_t seed, std::uint64_t stream) {
  CounterRandom random(seed, stream, 0x75756964);  // "uuid"
  Uuid uuid;
  for (std::size_t half = 0; half < 2; ++half) {
    std::uint64_t word = random.next_u64();
    for (std::size_t i = 0; i < 8; ++i, word >>= 8) uuid.bytes[half * 8 + i] = static_cast<std::uint8_t>(word & 0xFF);
  }
  uuid.bytes[6] = static_cast<std::uint8_t>((uuid.bytes[6] & 0x0F) | 0x40);
  uuid.bytes[8] = static_cast<std::uint8_t>((uuid.bytes[8] & 0x3F) | 0x80);
  return uuid;
}

}  // namespace submapd
