// Turns the bytes of a SCIP 2.0 sensor into events: every line summed, every byte range-checked, every value counted.
//
// One thread. Never blocks, never throws, never allocates: all memory is in the object (80 kB). The events do not
// depend on how the bytes are cut into feed() calls. Framing, checks and the way back after a fault follow the rules of
// SCIP 2.0 (C-42-03320B) as real sensors keep them: a damaged frame gives one fault; then everything is skipped up to a
// blank line or up to a line that is exactly an expected echo.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "driver/scip/command.hpp"
#include "driver/scip/event.hpp"

namespace submapd::driver::scip {

class Parser {
 public:
  static constexpr std::size_t kMaxLine = 128;    // bytes before the line feed
  static constexpr std::size_t kMaxPending = 64;  // commands sent and not answered
  static constexpr std::size_t kMaxBeams = 1536;  // largest of the maker's SCIP sensors: UXM-30LX-E, 1521
  static constexpr std::size_t kMaxEchoes = 3;    // of one beam
  static constexpr std::size_t kMaxParameters = 32;

  // Tells that `command` was sent: only replies to such commands, and the stream that runs, are accepted.
  // False, and no effect, if too many are unanswered or if its scan would have more than kMaxBeams beams.
  bool expect(const Command& command) noexcept;

  // Drops the commands that were not answered: their late answers become bad_echo faults. The stream goes on.
  void forget() noexcept { pending_count_ = 0; }

  // REQUIRES: bytes in the order in which they came. arrival_ns is when they came (any clock; passed on in the events).
  void feed(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns, Listener& listener) noexcept;

  // Silence: what is unfinished is a kTruncated fault; a later echo is accepted again.
  void end(std::int64_t now_ns, Listener& listener) noexcept;

  // As constructed, e.g. after the device was opened again.
  void reset() noexcept;

 private:
  enum class State : std::uint8_t { kIdle, kStatus, kTime, kData, kParameters, kNoBody, kSkip };
  enum class EchoKind : std::uint8_t { kNone, kPending, kStream, kDrained };

  void end_line(std::string_view line, bool oversize, Listener& listener) noexcept;
  [[nodiscard]] EchoKind find_echo(std::string_view line) noexcept;
  bool open(std::string_view line) noexcept;
  void on_echo_line(std::string_view line, Listener& listener) noexcept;
  void on_status_line(std::string_view line, Listener& listener) noexcept;
  void on_time_line(std::string_view line, Listener& listener) noexcept;
  void on_data_line(std::string_view line, Listener& listener) noexcept;
  void on_parameter_line(std::string_view line, Listener& listener) noexcept;
  void on_surplus_line(std::string_view line, Listener& listener) noexcept;
  void fail(FaultClass fault, FaultPlace place, std::uint32_t line, Listener& listener) noexcept;
  bool reopen(std::string_view line, Listener& listener) noexcept;

  void finish(Listener& listener) noexcept;
  void finish_stream_status(const Frame& frame, Listener& listener) noexcept;
  void finish_scan(const Frame& frame, Listener& listener) noexcept;
  void finish_reply(const Frame& frame, Listener& listener) noexcept;
  bool decode_single() noexcept;
  bool decode_multi() noexcept;
  void close() noexcept;

  [[nodiscard]] bool carries_scan() const noexcept;

  // The line that is being collected, unless it lies whole in one chunk.
  std::array<char, kMaxLine> line_{};
  std::size_t line_size_ = 0;
  bool line_oversize_ = false;
  std::int64_t line_begin_ns_ = 0;
  std::int64_t now_ns_ = 0;

  // The frame that is open.
  State state_ = State::kIdle;
  Command command_;  // that it answers
  EchoKind echo_kind_ = EchoKind::kNone;
  ReplyStatus status_;
  std::uint32_t lines_ = 0;  // accepted in this frame
  std::int64_t frame_begin_ns_ = 0;
  std::uint64_t time_ = 0;
  bool short_line_ = false;  // the last data line was not full: no other may follow
  std::size_t data_size_ = 0;
  std::size_t most_data_ = 0;  // characters that the echo's beams can fill
  std::size_t parameter_count_ = 0;
  std::size_t parameter_text_size_ = 0;

  // What may be answered.
  std::array<Command, kMaxPending> pending_;
  std::size_t pending_count_ = 0;
  Command candidate_;               // the last line that find_echo() took for a stream's echo
  std::optional<Command> stream_;   // that runs
  std::optional<Command> drained_;  // that QT, RS or RT ended: its last scans may still come

  // Contents of the open frame. The data characters of all lines, without sums and line feeds, are strung together:
  // values straddle lines.
  static constexpr std::size_t kMaxData = kMaxBeams * (6 * kMaxEchoes + (kMaxEchoes - 1));
  std::array<char, kMaxData> data_{};
  std::array<std::uint32_t, kMaxBeams * kMaxEchoes> ranges_mm_{};
  std::array<std::uint32_t, kMaxBeams * kMaxEchoes> intensities_{};
  std::array<std::uint8_t, kMaxBeams> echo_counts_{};
  std::size_t value_count_ = 0;
  std::array<char, kMaxParameters * kMaxLine> parameter_text_{};
  std::array<Parameter, kMaxParameters> parameters_;
};

}  // namespace submapd::driver::scip
