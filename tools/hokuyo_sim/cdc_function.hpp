// What an emulated scanner looks like on the bus: its descriptors, its control requests, its bulk IN endpoint.
//
// Shared by the fronts that speak USB (umockdev, USB/IP). The layout is a plausible CDC-ACM one and not taken from a
// real scanner, so endpoint addresses and interface numbers may be varied. Thread-compatible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "driver/sim/sim_sensor.hpp"

namespace submapd::tools {

struct CdcLayout {
  std::uint16_t vendor_id = 0x15d1;
  std::uint16_t product_id = 0x0000;
  std::uint8_t control_interface = 0;
  std::uint8_t data_interface = 1;
  std::uint8_t bulk_in = 0x81;
  std::uint8_t bulk_out = 0x02;
  std::uint8_t interrupt_in = 0x83;
  bool is_serial = true;            // false: an interface class of another kind, with the same ids
  bool zero_length_packets = true;  // a message that fills its last packet is followed by an empty one
  bool stalls_line_coding = false;
};

// Device descriptor and full configuration descriptor, as sysfs shows them.
[[nodiscard]] std::vector<std::uint8_t> descriptors(const CdcLayout& layout);

// The answer to a control request of 8 setup bytes (and, to the host, at most wLength bytes); nothing: a stall.
[[nodiscard]] std::optional<std::vector<std::uint8_t>> answer_control(const CdcLayout& layout,
                                                                      std::span<const std::uint8_t> setup);

// Bytes that wait to be fetched, with the packets' edges that end a transfer early.
class BulkInQueue {
 public:
  static constexpr std::size_t kMostBytes = 1 << 20;  // what nobody fetches is lost beyond, as in a sensor

  explicit BulkInQueue(bool zero_length_packets) : zero_length_packets_(zero_length_packets) {}

  void push(std::vector<std::uint8_t> bytes, bool message_end);
  void clear();
  // Copies into a transfer's buffer, which has room from `filled` on, and moves `filled`. True if the transfer is
  // complete.
  [[nodiscard]] bool fill(std::span<std::uint8_t> buffer, std::size_t& filled);

 private:
  struct Piece {
    std::vector<std::uint8_t> bytes;
    bool message_end = false;
  };
  std::deque<Piece> pieces_;
  std::size_t waiting_ = 0;        // bytes
  std::size_t taken_ = 0;          // of the first piece
  std::size_t message_bytes_ = 0;  // since the last message's end
  bool zero_length_packets_;
};

}  // namespace submapd::tools
