// Reads the scans of a CARMEN text log; see carmen_line.hpp for the lines.
//
// Scan::index counts from 0. Made by open_log().
#pragma once

#include <optional>
#include <string_view>

#include "tools/log/carmen_line.hpp"
#include "tools/log/input_buffer.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::tools {

class CarmenReader final : public LogReader {
 public:
  static constexpr std::size_t kMaxLine_bytes = std::size_t{1} << 20;  // longer lines are damage
  // Without a single record in so many bytes this is no such log, and reading on would only take time.
  static constexpr std::uint64_t kGiveUp_bytes = std::uint64_t{16} << 20;

  explicit CarmenReader(InputBuffer input) : input_(std::move(input)) {}

  Expected<std::optional<Scan>> next() override;
  const LogSummary& summary() const override { return summary_; }
  double progress() const override { return input_.progress(); }

 private:
  struct Line {
    std::string_view text;       // without the line feed; its front only if it is too long
    std::size_t size_bytes = 0;  // of all of it, to be consumed
    bool is_too_long = false;
    bool is_last = false;  // no line feed after it
  };
  // The line that starts at the window, nothing at the end of the input.
  std::optional<Line> look_at_line();
  void skip_long_line();
  void skip(const std::string& what, std::uint64_t size_bytes);
  void finish();

  InputBuffer input_;
  CarmenLineParser parser_;
  LogSummary summary_;
  std::uint64_t line_number_ = 0;
  std::int64_t last_stamp_us_ = 0;
  bool finished_ = false;
};

}  // namespace submapd::tools
