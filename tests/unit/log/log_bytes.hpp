// Makes the bytes of logs for the tests: CARMEN lines, LCM events, gzip and xz.
#pragma once

#include <fmt/format.h>
#include <lzma.h>
#include <zlib.h>

#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "tools/log/log_reader.hpp"

namespace submapd::tools::test {

// `end` is what follows the ranges.
inline std::string flaser(const std::vector<std::string>& ranges, const std::string& end) {
  return fmt::format("FLASER {} {} {}\n", ranges.size(), fmt::join(ranges, " "), end);
}

// A FLASER line with n equal ranges.
inline std::string plain_flaser(std::size_t beams, double stamp_s = 10.0) {
  return flaser(std::vector<std::string>(beams, "2.5"), fmt::format("0 0 0 1 2 0.5 {0:.6f} host {0:.6f}", stamp_s));
}

inline void put_big_endian(std::string& bytes, std::uint64_t value, int width) {
  for (int shift = 8 * (width - 1); shift >= 0; shift -= 8) bytes.push_back(static_cast<char>(value >> shift & 0xFFU));
}

inline std::string lcm_event(const std::string& channel, const std::string& data, std::uint64_t number = 0) {
  std::string bytes;
  put_big_endian(bytes, 0xEDA1DA01, 4);
  put_big_endian(bytes, number, 8);
  put_big_endian(bytes, 1000 * number, 8);
  put_big_endian(bytes, channel.size(), 4);
  put_big_endian(bytes, data.size(), 4);
  return bytes + channel + data;
}

inline std::string gzipped(const std::string& text) {
  z_stream stream{};
  if (deflateInit2(&stream, 9, Z_DEFLATED, MAX_WBITS + 16, 8, Z_DEFAULT_STRATEGY) != Z_OK) return {};
  std::string packed(deflateBound(&stream, text.size()) + 64, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

inline std::string xzipped(const std::string& text) {
  std::string packed(lzma_stream_buffer_bound(text.size()), '\0');
  std::size_t size = 0;
  lzma_easy_buffer_encode(6, LZMA_CHECK_CRC64, nullptr, reinterpret_cast<const std::uint8_t*>(text.data()), text.size(),
                          reinterpret_cast<std::uint8_t*>(packed.data()), &size, packed.size());
  packed.resize(size);
  return packed;
}

// Stands for the real decoder: channel SCAN carries the stamp as decimal text, "bad" is refused; others are not scans.
inline Expected<std::optional<Scan>> decode_double(std::string_view channel, std::span<const std::byte> data) {
  if (channel != "SCAN") return std::nullopt;
  const std::string text(reinterpret_cast<const char*>(data.data()), data.size());
  if (text.empty() || text.find_first_not_of("0123456789") != std::string::npos || text.size() > 18) {
    return failure(StatusCode::kCorrupt, "not decimal");
  }
  Scan scan;
  scan.stamp_us = std::stoll(text);
  return scan;
}

inline Expected<std::unique_ptr<LogReader>> open_bytes(const std::string& bytes) {
  return open_log(open_memory(std::as_bytes(std::span(bytes))), "memory", decode_double);
}

struct Contents {
  Status status;  // of opening or of reading on
  std::vector<Scan> scans;
  LogSummary summary;
};

inline Contents read_all(Expected<std::unique_ptr<LogReader>> reader) {
  Contents contents;
  if (!reader) {
    contents.status = reader.error();
    return contents;
  }
  for (;;) {
    auto scan = (*reader)->next();
    if (!scan) contents.status = scan.error();
    if (!scan || !scan->has_value()) break;
    contents.scans.push_back(std::move(**scan));
  }
  contents.summary = (*reader)->summary();
  return contents;
}

inline Contents read_bytes(const std::string& bytes) {
  return read_all(open_bytes(bytes));
}

}  // namespace submapd::tools::test
