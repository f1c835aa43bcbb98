// LCM messages to bytes and back, where the bytes may come from anyone.
//
// The code lcm-gen makes allocates for whatever array length a message announces. decode_message() therefore compares
// the lengths with the bytes that are there before it lets that code run. It can, because in all our types the arrays
// of variable length come last and their int32 counts directly before them (types.md).
#pragma once

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "submapd/health_t.hpp"

namespace submapd {

// Payload and channel name of one datagram (LCM_SHORT_MESSAGE_MAX_SIZE on Linux, less the channel's terminator).
inline constexpr std::size_t kMaxDatagramBytes = 65'498;
// What our own messages keep to, whatever the channel's name.
inline constexpr std::size_t kMaxMessageBytes = 61'000;

template <typename T>
[[nodiscard]] std::vector<std::byte> encode_message(const T& message) {
  const int size = message.getEncodedSize();
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  message.encode(bytes.data(), 0, size);
  return bytes;
}

namespace internal {

// Big-endian int32 at an offset. REQUIRES: offset + 4 <= bytes.size().
[[nodiscard]] inline std::int32_t int32_at(std::span<const std::byte> bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = (value << 8) | static_cast<std::uint32_t>(bytes[offset + i]);
  return static_cast<std::int32_t>(value);
}

}  // namespace internal

// `item_bytes`: encoded size of one item of each variable array, in order. Errors: kCorrupt.
template <typename T, std::size_t N>
[[nodiscard]] Expected<T> decode_message(std::span<const std::byte> bytes,
                                         const std::array<std::size_t, N>& item_bytes) {
  T message{};
  const std::size_t fixed_bytes = static_cast<std::size_t>(message.getEncodedSize());
  const auto corrupt = [&](std::string_view what) {
    return failure(StatusCode::kCorrupt, fmt::format("{} of {} bytes: {}", T::getTypeName(), bytes.size(), what));
  };
  if (bytes.size() < fixed_bytes) return corrupt("cut short");
  if (bytes.size() > kMaxDatagramBytes) return corrupt("larger than a datagram");
  std::size_t expected_bytes = fixed_bytes;
  for (std::size_t i = 0; i < N; ++i) {
    const std::int32_t count = internal::int32_at(bytes, fixed_bytes - 4 * (N - i));
    if (count < 0) return corrupt("negative array length");
    expected_bytes += static_cast<std::size_t>(count) * item_bytes[i];
  }
  if (bytes.size() != expected_bytes) return corrupt("array lengths do not match the size");
  const int decoded = message.decode(bytes.data(), 0, static_cast<int>(bytes.size()));
  if (decoded != static_cast<int>(bytes.size())) return corrupt("not of this type, or of another version of it");
  return message;
}

template <typename T>
[[nodiscard]] Expected<T> decode_message(std::span<const std::byte> bytes) {
  return decode_message<T>(bytes, std::array<std::size_t, 0>{});
}

// For types that end with a string, whose count includes the terminator. Errors: kCorrupt.
template <typename T>
[[nodiscard]] Expected<T> decode_with_text(std::span<const std::byte> bytes) {
  T message{};
  const std::size_t fixed_bytes = static_cast<std::size_t>(message.getEncodedSize()) - 1;
  if (bytes.size() <= fixed_bytes || bytes.size() > kMaxDatagramBytes ||
      internal::int32_at(bytes, fixed_bytes - 4) != static_cast<std::int64_t>(bytes.size() - fixed_bytes)) {
    return failure(StatusCode::kCorrupt, fmt::format("{} of {} bytes: wrong size", T::getTypeName(), bytes.size()));
  }
  if (message.decode(bytes.data(), 0, static_cast<int>(bytes.size())) != static_cast<int>(bytes.size())) {
    return failure(StatusCode::kCorrupt,
                   fmt::format("{}: not of this type, or of another version of it", T::getTypeName()));
  }
  return message;
}

[[nodiscard]] inline Expected<health_t> decode_health(std::span<const std::byte> bytes) {
  return decode_with_text<health_t>(bytes);
}

inline void put_uuid(const Uuid& uuid, std::uint8_t (&field)[16]) {
  for (std::size_t i = 0; i < 16; ++i) field[i] = uuid.bytes[i];
}
[[nodiscard]] inline Uuid get_uuid(const std::uint8_t (&field)[16]) {
  Uuid uuid;
  for (std::size_t i = 0; i < 16; ++i) uuid.bytes[i] = field[i];
  return uuid;
}
inline void put_pose(const Pose2& pose, double (&field)[3]) {
  field[0] = pose.x;
  field[1] = pose.y;
  field[2] = pose.yaw;
}
[[nodiscard]] inline Pose2 get_pose(const double (&field)[3]) {
  return {field[0], field[1], field[2]};
}

}  // namespace submapd
