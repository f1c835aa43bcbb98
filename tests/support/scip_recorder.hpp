// Writes each event of a SCIP parser down as a line of text, so that tests can compare whole streams.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "driver/scip/parser.hpp"

namespace submapd::test {

class ScipRecorder final : public driver::scip::Listener {
 public:
  std::vector<std::string> events;

  void on_scan(const driver::scip::ScanData& scan) noexcept override { add_scan("scan", scan); }
  void on_stale_scan(const driver::scip::ScanData& scan) noexcept override { add_scan("stale_scan", scan); }
  void on_stream_start(const driver::scip::Frame& frame) noexcept override { add("ack", frame); }
  void on_stream_status(const driver::scip::Frame& frame) noexcept override { add("stream_status", frame); }
  void on_time(const driver::scip::Frame& frame, std::uint64_t time) noexcept override {
    add("time", frame, " t=" + std::to_string(time));
  }
  void on_reply(const driver::scip::Frame& frame,
                std::span<const driver::scip::Parameter> parameters) noexcept override {
    std::string text;
    for (const auto& [key, value] : parameters) text.append(" ").append(key).append("=").append(value);
    add("reply", frame, text);
  }
  void on_fault(const driver::scip::Fault& fault) noexcept override {
    events.push_back("fault:" + std::string(name(fault.fault)) + " " + std::string(name(fault.place)) + " " +
                     std::to_string(fault.line));
  }

  // The first word of each event.
  [[nodiscard]] std::vector<std::string> kinds() const {
    std::vector<std::string> result;
    for (const std::string& event : events) result.push_back(event.substr(0, event.find(' ')));
    return result;
  }

 private:
  void add(std::string_view kind, const driver::scip::Frame& frame, const std::string& more = {}) {
    events.push_back(std::string(kind) + " " + std::string(frame.echo) + " " + std::string(frame.status.text()) + more);
  }

  template <typename T>
  static void append(std::string& text, std::string_view title, std::span<const T> values) {
    text.append(title);
    for (const T value : values) text.append(std::to_string(value)).append(",");
  }

  void add_scan(std::string_view kind, const driver::scip::ScanData& scan) {
    std::string text = " t=" + std::to_string(scan.time);
    append(text, " ranges=", scan.ranges_mm);
    append(text, " intensities=", scan.intensities);
    append(text, " echoes=", scan.echo_counts);
    add(kind, scan.frame, text);
  }
};

[[nodiscard]] inline std::span<const std::uint8_t> as_bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// Events of a whole stream that comes in chunks of next_size() bytes, for commands sent before.
template <typename NextSize>
[[nodiscard]] ScipRecorder parse_chunks(std::span<const driver::scip::Command> sent, std::string_view rx,
                                        NextSize&& next_size) {
  driver::scip::Parser parser;
  for (const driver::scip::Command& command : sent) parser.expect(command);
  ScipRecorder recorder;
  while (!rx.empty()) {
    const std::string_view chunk = rx.substr(0, next_size());
    // Exactly as long as it may be read, so that AddressSanitizer sees a byte too many.
    const std::vector<std::uint8_t> bytes(chunk.begin(), chunk.end());
    parser.feed(bytes, 0, recorder);
    rx.remove_prefix(chunk.size());
  }
  parser.end(0, recorder);
  return recorder;
}

[[nodiscard]] inline ScipRecorder parse_whole(std::span<const driver::scip::Command> sent, std::string_view rx) {
  return parse_chunks(sent, rx, [&rx] { return rx.size(); });
}

}  // namespace submapd::test
