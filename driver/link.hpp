// The line between a transport (USB, or an emulated sensor in virtual time) and what speaks SCIP over it.
//
// Everything here is called on one thread, the transport's event thread. Times are CLOCK_MONOTONIC in nanoseconds, or
// the virtual time of a test. Nothing here allocates, blocks or throws.
#pragma once

#include <cstdint>
#include <limits>
#include <span>

namespace submapd::driver {

enum class LinkFault : std::uint8_t {
  kStall,     // the endpoint halted; cleared, bytes may be missing
  kOverflow,  // the device sent more than asked; those bytes are lost
  kTransfer,  // another failed transfer
  kWrite,     // what was written did not reach the device in 200 ms
};

// Towards the sensor. Owned by the transport, valid from on_open() until on_close() returns.
class ByteLink {
 public:
  // Sends bytes, at most 64 a call. False: the line is closed or too much is under way; try later.
  virtual bool write(std::span<const std::uint8_t> bytes) noexcept = 0;
  // Resets the device on its bus. on_close() follows, then on_open() if the device comes back.
  virtual void reset() noexcept = 0;

 protected:
  ~ByteLink() = default;
};

// From the sensor.
class LinkClient {
 public:
  static constexpr std::int64_t kNever_ns = std::numeric_limits<std::int64_t>::max();

  virtual void on_open(ByteLink& link, std::int64_t now_ns) noexcept = 0;
  virtual void on_close(std::int64_t now_ns) noexcept = 0;
  // The program ends: what is written now is still sent. on_close() follows.
  virtual void on_stop(std::int64_t now_ns) noexcept = 0;
  // `stamp_ns` was taken first thing when the transfer completed; `offset` counts the bytes received on this link
  // before these. The bytes are valid during the call only.
  virtual void on_bytes(std::span<const std::uint8_t> bytes, std::int64_t stamp_ns, std::uint64_t offset) noexcept = 0;
  virtual void on_fault(LinkFault fault, std::int64_t now_ns) noexcept = 0;
  // Called at or soon after next_time_ns(). Asked again after every other call.
  virtual void on_time(std::int64_t now_ns) noexcept = 0;
  [[nodiscard]] virtual std::int64_t next_time_ns() const noexcept = 0;

 protected:
  ~LinkClient() = default;
};

}  // namespace submapd::driver
