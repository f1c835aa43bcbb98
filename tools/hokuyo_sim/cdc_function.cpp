#include "tools/hokuyo_sim/cdc_function.hpp"

#include <algorithm>
#include <cstring>
#include <string_view>
#include <utility>

namespace submapd::tools {
namespace {

constexpr std::size_t kPacket = 64;

// Request codes of chapter 9 of the USB 2.0 specification and of CDC PSTN 1.2.
constexpr std::uint8_t kGetStatus = 0x00;
constexpr std::uint8_t kGetDescriptor = 0x06;
constexpr std::uint8_t kSetLineCoding = 0x20;
constexpr std::uint8_t kGetLineCoding = 0x21;
constexpr std::uint8_t kSetControlLineState = 0x22;

std::vector<std::uint8_t> string_descriptor(std::string_view text) {
  std::vector<std::uint8_t> out = {static_cast<std::uint8_t>(2 + 2 * text.size()), 3};
  for (const char c : text) {
    out.push_back(static_cast<std::uint8_t>(c));
    out.push_back(0);
  }
  return out;
}

}  // namespace

std::vector<std::uint8_t> descriptors(const CdcLayout& layout) {
  const auto low = [](std::uint16_t value) { return static_cast<std::uint8_t>(value & 0xFF); };
  const auto high = [](std::uint16_t value) { return static_cast<std::uint8_t>(value >> 8); };
  const std::uint8_t control_class = layout.is_serial ? 0x02 : 0xFF;
  const std::uint8_t data_class = layout.is_serial ? 0x0A : 0xFF;
  std::vector<std::uint8_t> out = {18,
                                   1,
                                   0x00,
                                   0x02,
                                   0x02,
                                   0,
                                   0,
                                   kPacket,
                                   low(layout.vendor_id),
                                   high(layout.vendor_id),
                                   low(layout.product_id),
                                   high(layout.product_id),
                                   0x00,
                                   0x01,
                                   1,
                                   2,
                                   0,
                                   1};
  const std::vector<std::uint8_t> control = {9,
                                             4,
                                             layout.control_interface,
                                             0,
                                             1,
                                             control_class,
                                             2,
                                             1,
                                             0,  // interface
                                             5,
                                             0x24,
                                             0x00,
                                             0x10,
                                             0x01,  // header
                                             5,
                                             0x24,
                                             0x01,
                                             0x00,
                                             layout.data_interface,  // call management
                                             4,
                                             0x24,
                                             0x02,
                                             0x02,  // ACM
                                             5,
                                             0x24,
                                             0x06,
                                             layout.control_interface,
                                             layout.data_interface,  // union
                                             7,
                                             5,
                                             layout.interrupt_in,
                                             3,
                                             8,
                                             0,
                                             16};
  const std::vector<std::uint8_t> data = {
      9, 4, layout.data_interface, 0, 2,       data_class, 0, 0, 0, 7, 5, layout.bulk_out, 2, kPacket, 0, 0,
      7, 5, layout.bulk_in,        2, kPacket, 0,          0};
  const auto total = static_cast<std::uint16_t>(9 + control.size() + data.size());
  const std::vector<std::uint8_t> head = {9, 2, low(total), high(total), 2, 1, 0, 0xC0, 50};
  out.insert(out.end(), head.begin(), head.end());
  const bool control_first = layout.control_interface < layout.data_interface;
  for (const auto* const part : {control_first ? &control : &data, control_first ? &data : &control}) {
    out.insert(out.end(), part->begin(), part->end());
  }
  return out;
}

std::optional<std::vector<std::uint8_t>> answer_control(const CdcLayout& layout, std::span<const std::uint8_t> setup) {
  if (setup.size() < 8) {
    return std::nullopt;
  }
  const std::uint8_t request = setup[1];
  const std::uint8_t value_low = setup[2];
  const std::uint8_t value_high = setup[3];
  const auto length = static_cast<std::size_t>(setup[6] | (setup[7] << 8));
  std::vector<std::uint8_t> answer;
  if (request == kGetDescriptor && value_high == 3) {
    static constexpr std::string_view kStrings[] = {"", "Hokuyo Data Flex for USB", "URG-Series USB Driver"};
    if (value_low > 2) {
      return std::nullopt;
    }
    answer = value_low == 0 ? std::vector<std::uint8_t>{4, 3, 0x09, 0x04} : string_descriptor(kStrings[value_low]);
  } else if (request == kGetDescriptor && (value_high == 1 || value_high == 2)) {
    const std::vector<std::uint8_t> all = descriptors(layout);
    answer.assign(value_high == 1 ? all.begin() : all.begin() + 18, value_high == 1 ? all.begin() + 18 : all.end());
  } else if (request == kGetStatus) {
    answer = {0, 0};
  } else if (request == kGetLineCoding) {
    answer = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8};
  } else if (request == kSetLineCoding || request == kSetControlLineState) {
    if (layout.stalls_line_coding) {
      return std::nullopt;
    }
  } else if (request != 0x09 && request != 0x0B && request != 0x01 && request != 0x03) {
    return std::nullopt;  // all but SET_CONFIGURATION, SET_INTERFACE and the features
  }
  answer.resize(std::min(answer.size(), length));
  return answer;
}

void BulkInQueue::push(std::vector<std::uint8_t> bytes, bool message_end) {
  if (!bytes.empty() && waiting_ + bytes.size() <= kMostBytes) {
    waiting_ += bytes.size();
    pieces_.push_back({std::move(bytes), message_end});
  }
}

void BulkInQueue::clear() {
  pieces_.clear();
  waiting_ = 0;
  taken_ = 0;
  message_bytes_ = 0;
}

bool BulkInQueue::fill(std::span<std::uint8_t> buffer, std::size_t& filled) {
  while (!pieces_.empty()) {
    Piece& piece = pieces_.front();
    const std::size_t length = std::min(buffer.size() - filled, piece.bytes.size() - taken_);
    if (length > 0) {
      std::memcpy(buffer.data() + filled, piece.bytes.data() + taken_, length);
    }
    filled += length;
    taken_ += length;
    waiting_ -= length;
    message_bytes_ += length;
    const bool piece_done = taken_ == piece.bytes.size();
    bool short_packet = false;
    if (piece_done) {
      const bool message_done = piece.message_end;
      const bool full_packet = message_bytes_ % kPacket == 0;
      const bool empty_packet_waits = message_done && full_packet && zero_length_packets_ && filled == buffer.size();
      short_packet = message_done && (!full_packet || zero_length_packets_);
      if (empty_packet_waits) {
        piece = Piece{{}, true};  // ends the next transfer with no bytes
        taken_ = 0;
        return true;
      }
      message_bytes_ = message_done ? 0 : message_bytes_;
      pieces_.pop_front();
      taken_ = 0;
    }
    if (short_packet || filled == buffer.size()) {
      return true;
    }
  }
  return false;
}

}  // namespace submapd::tools
