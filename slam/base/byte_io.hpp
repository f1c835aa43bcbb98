// Little-endian fields to and from bytes, for our own file formats.
//
// The same bytes on every machine. Doubles and floats travel as their IEEE 754 bits, so every value comes back exactly.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace submapd {

static_assert(sizeof(double) == 8 && sizeof(float) == 4);

// Appends fields to a vector it owns.
class ByteWriter {
 public:
  template <std::unsigned_integral T>
  void put(T value) {
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes_.push_back(static_cast<std::byte>((value >> (8 * i)) & 0xFF));
  }
  void put(std::int32_t value) { put(static_cast<std::uint32_t>(value)); }
  void put(std::int64_t value) { put(static_cast<std::uint64_t>(value)); }
  void put(double value) { put(std::bit_cast<std::uint64_t>(value)); }
  void put(float value) { put(std::bit_cast<std::uint32_t>(value)); }
  void put(bool value) { put(static_cast<std::uint8_t>(value ? 1 : 0)); }
  void put(std::span<const std::byte> bytes) { bytes_.insert(bytes_.end(), bytes.begin(), bytes.end()); }
  void put(std::span<const std::uint8_t> bytes) { put(std::as_bytes(bytes)); }

  [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }
  [[nodiscard]] std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  std::vector<std::byte> bytes_;
};

// Takes fields from borrowed bytes. Reading past the end gives zeros and clears ok(); the caller asks once at the end
// of a group of fields, and asks fits() before it allocates for a count it read.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <std::unsigned_integral T>
  [[nodiscard]] T get() {
    T value = 0;
    const std::span<const std::byte> field = get_bytes(sizeof(T));
    for (std::size_t i = 0; i < field.size(); ++i) {
      value = static_cast<T>(value | static_cast<T>(static_cast<T>(field[i]) << (8 * i)));
    }
    return value;
  }
  [[nodiscard]] std::int32_t get_i32() { return static_cast<std::int32_t>(get<std::uint32_t>()); }
  [[nodiscard]] std::int64_t get_i64() { return static_cast<std::int64_t>(get<std::uint64_t>()); }
  [[nodiscard]] double get_f64() { return std::bit_cast<double>(get<std::uint64_t>()); }
  [[nodiscard]] float get_f32() { return std::bit_cast<float>(get<std::uint32_t>()); }
  // The next `count` bytes, or none.
  [[nodiscard]] std::span<const std::byte> get_bytes(std::size_t count) {
    if (count > remaining()) {
      ok_ = false;
      position_ = bytes_.size();
      return {};
    }
    position_ += count;
    return bytes_.subspan(position_ - count, count);
  }

  // Whether `count` items of at least `item_bytes` each can still follow. REQUIRES: item_bytes > 0.
  [[nodiscard]] bool fits(std::uint64_t count, std::size_t item_bytes) const {
    return count <= remaining() / item_bytes;
  }
  [[nodiscard]] std::size_t remaining() const { return bytes_.size() - position_; }
  [[nodiscard]] std::size_t position() const { return position_; }
  [[nodiscard]] bool ok() const { return ok_; }

 private:
  std::span<const std::byte> bytes_;
  std::size_t position_ = 0;
  bool ok_ = true;
};

}  // namespace submapd
