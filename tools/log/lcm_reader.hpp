// Reads the scans of an LCM event log (.lcmlog).
//
// An event is a 28-byte big-endian header - sync word 0xEDA1DA01, event number (64 bits), time stamp in us (64), length
// of the channel's name (32), length of the data (32) - then the name without NUL, then the data (LCM's documentation,
// "Log File format"). There is neither index nor checksum: after damage the reader looks for the next sync word. Made
// by open_log().
#pragma once

#include <optional>
#include <span>

#include "tools/log/input_buffer.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::tools {

// Whether the sync word occurs in the bytes. A text log never has it.
[[nodiscard]] bool has_lcm_event(std::span<const std::byte> front);

class LcmReader final : public LogReader {
 public:
  static constexpr std::size_t kHeader_bytes = 28;
  static constexpr std::size_t kMaxChannel_bytes = 63;                     // LCM's own limit
  static constexpr std::size_t kMaxData_bytes = std::size_t{4} << 20;      // a scan has some kB
  static constexpr std::uint64_t kGiveUp_bytes = std::uint64_t{16} << 20;  // as for CARMEN logs

  LcmReader(InputBuffer input, ScanDecoder decoder) : input_(std::move(input)), decoder_(std::move(decoder)) {}

  Expected<std::optional<Scan>> next() override;
  const LogSummary& summary() const override { return summary_; }
  double progress() const override { return input_.progress(); }

 private:
  // The event at the window; `size_bytes` of them are to be consumed.
  struct Event {
    std::string_view channel;
    std::span<const std::byte> data;
    std::size_t size_bytes = 0;
  };
  // kCorrupt: no event starts here; the message says why.
  Expected<Event> look_at_event();
  void skip_to_sync(const std::string& why);
  void finish();

  InputBuffer input_;
  ScanDecoder decoder_;
  LogSummary summary_;
  std::int64_t last_stamp_us_ = 0;
  std::uint64_t skip_bytes_ = 0;  // of the newest skipped stretch
  std::uint64_t skip_end_ = 0;    // and where it ends
  bool finished_ = false;
};

}  // namespace submapd::tools
