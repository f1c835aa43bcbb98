#include "tools/log/lcm_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace submapd::tools {
namespace {

constexpr std::array<std::byte, 4> kSync = {std::byte{0xED}, std::byte{0xA1}, std::byte{0xDA}, std::byte{0x01}};
constexpr std::size_t kChannelLengthAt = 20;
constexpr std::size_t kDataLengthAt = 24;

static_assert(LcmReader::kHeader_bytes + LcmReader::kMaxChannel_bytes + LcmReader::kMaxData_bytes + kSync.size() <=
              InputBuffer::kMaxWindow);

std::uint32_t big_endian_u32(std::span<const std::byte> bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value = value << 8 | std::to_integer<std::uint32_t>(bytes[at + i]);
  return value;
}

// Offset of the first sync word at or after `from`, or bytes.size().
std::size_t find_sync(std::span<const std::byte> bytes, std::size_t from) {
  const auto start = bytes.begin() + static_cast<std::ptrdiff_t>(std::min(from, bytes.size()));
  return static_cast<std::size_t>(std::search(start, bytes.end(), kSync.begin(), kSync.end()) - bytes.begin());
}

bool starts_with_sync(std::span<const std::byte> bytes) {
  return bytes.size() >= kSync.size() && std::equal(kSync.begin(), kSync.end(), bytes.begin());
}

}  // namespace

bool has_lcm_event(std::span<const std::byte> front) {
  return find_sync(front, 0) != front.size();
}

Expected<std::optional<Scan>> LcmReader::next() {
  while (!finished_) {
    if (input_.peek(1).empty()) {
      if (input_.status().code() == StatusCode::kIo) return failure(input_.status());
      finish();
      break;
    }
    const auto event = look_at_event();
    if (!event) {
      skip_to_sync(event.error().message());
    } else {
      const std::uint64_t offset = input_.offset();
      auto scan = decoder_ ? decoder_(event->channel, event->data) : std::optional<Scan>();
      input_.consume(event->size_bytes);
      if (!scan) {
        ++summary_.skipped_records;
        summary_.skipped_bytes += event->size_bytes;
        summary_.add_problem(fmt::format("byte {}: {}", offset, scan.error().message()));
      } else if (scan->has_value()) {
        const std::int64_t stamp_us = (*scan)->stamp_us;
        if (summary_.scans++ > 0 && stamp_us < last_stamp_us_) ++summary_.backward_stamps;
        last_stamp_us_ = stamp_us;
        return scan;
      } else {
        ++summary_.other_records;
      }
    }
    if (summary_.scans + summary_.other_records == 0 && input_.offset() > kGiveUp_bytes) finish();
  }
  return std::nullopt;
}

Expected<LcmReader::Event> LcmReader::look_at_event() {
  auto window = input_.peek(kHeader_bytes);
  if (!starts_with_sync(window)) return failure(StatusCode::kCorrupt, "no event starts here");
  if (window.size() < kHeader_bytes) return failure(StatusCode::kCorrupt, "the log ends within an event's header");
  const std::size_t channel_bytes = big_endian_u32(window, kChannelLengthAt);
  const std::size_t data_bytes = big_endian_u32(window, kDataLengthAt);
  if (channel_bytes == 0 || channel_bytes > kMaxChannel_bytes) {
    return failure(StatusCode::kCorrupt,
                   fmt::format("an event's channel name has {} bytes, not 1 to {}", channel_bytes, kMaxChannel_bytes));
  }
  if (data_bytes > kMaxData_bytes) {
    return failure(StatusCode::kCorrupt,
                   fmt::format("an event has {} bytes of data, more than {}", data_bytes, kMaxData_bytes));
  }
  const std::size_t size_bytes = kHeader_bytes + channel_bytes + data_bytes;
  window = input_.peek(size_bytes + kSync.size());
  if (window.size() < size_bytes) return failure(StatusCode::kCorrupt, "the log ends within an event");
  // If no event follows and one starts within this one's bytes, then its length is damaged and must not swallow others.
  if (window.size() >= size_bytes + kSync.size() && !starts_with_sync(window.subspan(size_bytes)) &&
      find_sync(window.first(size_bytes + kSync.size()), kSync.size()) != size_bytes + kSync.size()) {
    return failure(StatusCode::kCorrupt, "an event's length is wrong: others start within it");
  }
  return Event{.channel = {reinterpret_cast<const char*>(window.data()) + kHeader_bytes, channel_bytes},
               .data = window.subspan(kHeader_bytes + channel_bytes, data_bytes),
               .size_bytes = size_bytes};
}

void LcmReader::skip_to_sync(const std::string& why) {
  const std::uint64_t start = input_.offset();
  // Past this very sync word, if there is one.
  input_.consume(1);
  while (input_.offset() - start <= kGiveUp_bytes) {
    const auto window = input_.peek(kSync.size());
    const std::size_t sync_at = find_sync(window, 0);
    if (sync_at != window.size() || window.size() < kSync.size()) {
      input_.consume(sync_at);
      break;
    }
    input_.consume(window.size() - (kSync.size() - 1));  // the last three may begin one
  }
  const std::uint64_t size_bytes = input_.offset() - start;
  skip_bytes_ = size_bytes;
  skip_end_ = input_.offset();
  ++summary_.skipped_records;
  summary_.skipped_bytes += size_bytes;
  summary_.add_problem(fmt::format("byte {}: {}; skipped {} bytes", start, why, size_bytes));
}

void LcmReader::finish() {
  finished_ = true;
  if (skip_end_ == input_.offset()) summary_.tail_bytes = skip_bytes_;
  if (input_.status().ok()) return;
  summary_.unreadable_tail = true;
  summary_.add_problem(fmt::format("after byte {}: {}", input_.offset(), input_.status().message()));
}

}  // namespace submapd::tools
