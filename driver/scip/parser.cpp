#include "driver/scip/parser.hpp"

#include <algorithm>
#include <cstring>

#include "driver/scip/code.hpp"

namespace submapd::driver::scip {
namespace {

constexpr std::size_t kStatusLine = 3;  // two characters and their sum

bool is_text(std::string_view line) {
  return std::all_of(line.begin(), line.end(), is_printable);
}

bool is_status_character(char c) {
  return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z');
}

// Sum and range check of a line in one pass. Byte arithmetic without branches, so that the compiler can take several
// characters at once (bench_scip).
struct LineCheck {
  bool characters = false;  // all code values, the sum included
  bool sum = false;
};

// REQUIRES: two characters at least.
LineCheck check_coded(std::string_view line) {
  std::uint8_t sum = 0;
  std::uint8_t bits = 0;
  for (const char c : line.substr(0, line.size() - 1)) {
    const auto byte = static_cast<std::uint8_t>(c);
    sum = static_cast<std::uint8_t>(sum + byte);
    bits = static_cast<std::uint8_t>(bits | static_cast<std::uint8_t>(byte - kCodeOffset));
  }
  const char expected = static_cast<char>((sum & kCodeMask) + kCodeOffset);
  return {bits <= kCodeMask && is_code(line.back()), line.back() == expected};
}

// The same where '&' may stand between two echoes.
LineCheck check_coded_or_separator(std::string_view line) {
  const std::string_view text = line.substr(0, line.size() - 1);
  const bool characters = std::all_of(text.begin(), text.end(), [](char c) { return is_code(c) || c == '&'; });
  return {characters && is_code(line.back()), line.back() == checksum(text)};
}

std::uint32_t six_bits(char c) {
  return static_cast<std::uint8_t>(c) - kCodeOffset;
}
std::uint32_t decode2(const char* p) {
  return six_bits(p[0]) << 6 | six_bits(p[1]);
}
std::uint32_t decode3(const char* p) {
  return six_bits(p[0]) << 12 | six_bits(p[1]) << 6 | six_bits(p[2]);
}

}  // namespace

bool Parser::expect(const Command& command) noexcept {
  const bool scan = command.kind() == CommandKind::kScanOnce || command.kind() == CommandKind::kScanStream;
  if (pending_count_ == kMaxPending || (scan && command.request().beams() > kMaxBeams)) return false;
  pending_[pending_count_++] = command;
  return true;
}

void Parser::reset() noexcept {
  line_size_ = 0;
  line_oversize_ = false;
  state_ = State::kIdle;
  lines_ = 0;
  pending_count_ = 0;
  stream_.reset();
  drained_.reset();
}

void Parser::feed(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns, Listener& listener) noexcept {
  now_ns_ = arrival_ns;
  std::string_view rest(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  while (!rest.empty()) {
    const bool begins = line_size_ == 0 && !line_oversize_;
    if (begins) line_begin_ns_ = arrival_ns;
    const std::size_t feed_at = rest.find('\n');
    if (begins && feed_at <= kMaxLine) {  // the whole line is here: no copy
      end_line(rest.substr(0, feed_at), false, listener);
    } else {
      const std::size_t taken = std::min(feed_at, rest.size());
      const std::size_t kept = std::min(taken, kMaxLine - line_size_);
      if (kept > 0) std::memcpy(line_.data() + line_size_, rest.data(), kept);
      line_size_ += kept;
      line_oversize_ = line_oversize_ || kept < taken;
      if (feed_at == rest.npos) return;
      const std::string_view line(line_.data(), line_size_);
      const bool oversize = line_oversize_;
      line_size_ = 0;
      line_oversize_ = false;
      end_line(line, oversize, listener);
    }
    rest.remove_prefix(feed_at + 1);
  }
}

void Parser::end(std::int64_t now_ns, Listener& listener) noexcept {
  now_ns_ = now_ns;
  if (line_size_ > 0 || line_oversize_ || lines_ > 0) fail(FaultClass::kTruncated, FaultPlace::kEnd, lines_, listener);
  line_size_ = 0;
  line_oversize_ = false;
}

void Parser::end_line(std::string_view line, bool oversize, Listener& listener) noexcept {
  if (state_ == State::kSkip) {
    if (oversize) return;
    if (line.empty()) {
      state_ = State::kIdle;
    } else {
      open(line);
    }
    return;
  }
  if (oversize) return fail(FaultClass::kOversizeLine, FaultPlace::kLine, lines_, listener);
  if (state_ == State::kIdle) return on_echo_line(line, listener);
  if (state_ == State::kStatus) return on_status_line(line, listener);
  if (line.empty()) return finish(listener);
  switch (state_) {
    case State::kTime:
      return on_time_line(line, listener);
    case State::kData:
      return on_data_line(line, listener);
    case State::kParameters:
      return on_parameter_line(line, listener);
    default:
      return on_surplus_line(line, listener);
  }
}

Parser::EchoKind Parser::find_echo(std::string_view line) noexcept {
  const std::span<const Command> pending(pending_.data(), pending_count_);
  const auto sent = std::find_if(pending.begin(), pending.end(), [&](const Command& c) { return c.text() == line; });
  if (sent != pending.end()) {
    candidate_ = *sent;
    return EchoKind::kPending;
  }
  if (!stream_ && !drained_) return EchoKind::kNone;
  const std::optional<Command> echo = Command::parse(line);
  if (!echo || echo->kind() != CommandKind::kScanStream) return EchoKind::kNone;
  candidate_ = *echo;
  if (stream_ && stream_->same_stream(*echo)) return EchoKind::kStream;
  if (drained_ && drained_->same_stream(*echo)) return EchoKind::kDrained;
  return EchoKind::kNone;
}

// Begins a frame if the line is an expected echo.
bool Parser::open(std::string_view line) noexcept {
  const EchoKind kind = find_echo(line);
  if (kind == EchoKind::kNone) return false;
  command_ = candidate_;
  echo_kind_ = kind;
  state_ = State::kStatus;
  status_ = ReplyStatus();
  lines_ = 1;
  frame_begin_ns_ = line_begin_ns_;
  short_line_ = false;
  data_size_ = 0;
  parameter_count_ = 0;
  parameter_text_size_ = 0;
  return true;
}

void Parser::on_echo_line(std::string_view line, Listener& listener) noexcept {
  if (line.empty() || open(line)) return;  // stray blank lines do no harm
  fail(is_text(line) ? FaultClass::kBadEcho : FaultClass::kBadChar, FaultPlace::kEcho, 0, listener);
}

void Parser::on_status_line(std::string_view line, Listener& listener) noexcept {
  ++lines_;
  if (line == "0" && command_.text() == "SCIP2.0") {  // a sensor that still speaks SCIP 1.1: no sum
    status_ = ReplyStatus(line);
    state_ = State::kNoBody;
    return;
  }
  const auto bad = [&](FaultClass fault) { fail(fault, FaultPlace::kStatus, 1, listener); };
  if (line.size() != kStatusLine) return bad(FaultClass::kBadStatus);
  const std::string_view code = line.substr(0, 2);
  if (!std::all_of(code.begin(), code.end(), is_status_character)) return bad(FaultClass::kBadChar);
  if (line.back() != checksum(code)) return bad(FaultClass::kBadSum);
  status_ = ReplyStatus(code);
  const bool ok = status_ == "00";
  if (carries_scan() || (command_.kind() == CommandKind::kTime && ok)) {
    state_ = State::kTime;
  } else {
    state_ = command_.kind() == CommandKind::kParameters && ok ? State::kParameters : State::kNoBody;
  }
}

void Parser::on_time_line(std::string_view line, Listener& listener) noexcept {
  const bool microseconds = command_.text().starts_with('%');
  const auto bad = [&](FaultClass fault) { fail(fault, FaultPlace::kTime, lines_, listener); };
  if (line.size() != (microseconds ? kMicrosecondTimeCharacters : kTimeCharacters) + 1) {
    return bad(FaultClass::kBadLine);
  }
  const LineCheck check = check_coded(line);
  if (!check.characters) return bad(FaultClass::kBadChar);
  if (!check.sum) return bad(FaultClass::kBadSum);
  time_ = decode(line.substr(0, line.size() - 1));
  ++lines_;
  if (!carries_scan()) {
    state_ = State::kNoBody;
    return;
  }
  state_ = State::kData;
  const ScanRequest& request = command_.request();
  most_data_ = request.multi_echo() ? kMaxData : request.beams() * request.echo_characters();
}

void Parser::on_data_line(std::string_view line, Listener& listener) noexcept {
  const bool separators = command_.request().multi_echo();
  const auto bad = [&](FaultClass fault, std::uint32_t at) { fail(fault, FaultPlace::kData, at, listener); };
  const bool length = line.size() >= 2 && line.size() <= kBlock + 1;
  LineCheck check;
  if (length) check = separators ? check_coded_or_separator(line) : check_coded(line);
  if (!length || !check.characters || !check.sum) {
    // An echo in place of data: the sensor began anew, or the blank line was lost.
    if (reopen(line, listener)) return;
    if (!length) return bad(line.size() < 2 ? FaultClass::kBadLine : FaultClass::kOversizeLine, lines_);
    return bad(check.characters ? FaultClass::kBadSum : FaultClass::kBadChar, lines_);
  }
  if (short_line_) return bad(FaultClass::kBadLine, lines_ - 1);
  const std::size_t size = line.size() - 1;
  if (data_size_ + size > most_data_) return bad(FaultClass::kBadCount, lines_);
  std::memcpy(data_.data() + data_size_, line.data(), size);
  data_size_ += size;
  short_line_ = size < kBlock;
  ++lines_;
}

void Parser::on_parameter_line(std::string_view line, Listener& listener) noexcept {
  const auto bad = [&](FaultClass fault) { fail(fault, FaultPlace::kParam, lines_, listener); };
  if (!is_text(line)) return bad(FaultClass::kBadChar);
  if (line.size() < 3 || line[line.size() - 2] != ';') return bad(FaultClass::kBadParam);
  const std::string_view body = line.substr(0, line.size() - 2);
  const std::size_t colon = body.find(':');
  if (colon == body.npos || parameter_count_ == kMaxParameters) return bad(FaultClass::kBadParam);
  // Some firmware sums the lines SCSP and SBPS only up to "<-".
  if (line.back() != checksum(body) && line.back() != checksum(body.substr(0, body.find("<-")))) {
    return bad(FaultClass::kBadSum);
  }
  char* const kept = parameter_text_.data() + parameter_text_size_;
  std::memcpy(kept, body.data(), body.size());
  parameter_text_size_ += body.size();
  parameters_[parameter_count_++] = {{kept, colon}, {kept + colon + 1, body.size() - colon - 1}};
  ++lines_;
}

void Parser::on_surplus_line(std::string_view line, Listener& listener) noexcept {
  if (!reopen(line, listener)) fail(FaultClass::kBadLine, FaultPlace::kBody, lines_, listener);
}

// The blank line is missing if an expected echo stands in its place: that frame is not lost.
bool Parser::reopen(std::string_view line, Listener& listener) noexcept {
  if (find_echo(line) == EchoKind::kNone) return false;
  fail(FaultClass::kMissingTerminator, FaultPlace::kEnd, lines_, listener);
  return open(line);
}

void Parser::fail(FaultClass fault, FaultPlace place, std::uint32_t line, Listener& listener) noexcept {
  const Fault event{fault, place, line, lines_ > 0 && carries_scan(), now_ns_};
  state_ = State::kSkip;
  lines_ = 0;
  listener.on_fault(event);
}

bool Parser::carries_scan() const noexcept {
  return (command_.kind() == CommandKind::kScanStream && status_ == "99") ||
         (command_.kind() == CommandKind::kScanOnce && status_ == "00");
}

// The blank line came: all lines are good, what is missing shows now.
void Parser::finish(Listener& listener) noexcept {
  const Frame frame{command_.text(), status_, frame_begin_ns_, now_ns_};
  if (carries_scan()) return finish_scan(frame, listener);
  if (command_.kind() == CommandKind::kScanStream) return finish_stream_status(frame, listener);
  if (command_.kind() == CommandKind::kTime && status_ == "00") {
    if (state_ == State::kTime) {
      fail(FaultClass::kBadLine, FaultPlace::kTime, lines_, listener);
      state_ = State::kIdle;
      return;
    }
    close();
    return listener.on_time(frame, time_);
  }
  finish_reply(frame, listener);
}

void Parser::finish_stream_status(const Frame& frame, Listener& listener) noexcept {
  close();
  if (status_ == "00") {
    stream_ = command_;
    drained_.reset();
    return listener.on_stream_start(frame);
  }
  if (stream_ && stream_->same_stream(command_)) return listener.on_stream_status(frame);
  listener.on_reply(frame, {});
}

void Parser::finish_scan(const Frame& frame, Listener& listener) noexcept {
  const bool streams = command_.kind() == CommandKind::kScanStream;
  if (streams && !stream_ && echo_kind_ == EchoKind::kPending) stream_ = command_;  // its acknowledgement was lost
  const bool multi = command_.request().multi_echo();
  if (state_ != State::kData || data_size_ == 0 || !(multi ? decode_multi() : decode_single())) {
    fail(FaultClass::kBadCount, FaultPlace::kData, lines_, listener);
    state_ = State::kIdle;
    return;
  }
  close();
  ScanData scan{.frame = frame, .request = command_.request(), .time = time_};
  scan.ranges_mm = std::span(ranges_mm_).first(value_count_);
  if (scan.request.intensities()) scan.intensities = std::span(intensities_).first(value_count_);
  if (multi) scan.echo_counts = std::span(echo_counts_).first(scan.request.beams());
  if (echo_kind_ == EchoKind::kDrained) return listener.on_stale_scan(scan);
  listener.on_scan(scan);
}

void Parser::finish_reply(const Frame& frame, Listener& listener) noexcept {
  const std::string_view name = frame.echo.substr(0, 2);
  if (stream_ && status_ == "00" && (name == "QT" || name == "RS" || name == "RT")) {
    drained_ = stream_;
    stream_.reset();
  }
  close();
  listener.on_reply(frame, std::span(parameters_).first(parameter_count_));
}

// The frame is complete. Its command is answered, unless it is a stream, which only its acknowledgement answers.
void Parser::close() noexcept {
  state_ = State::kIdle;
  lines_ = 0;
  if (command_.kind() == CommandKind::kScanStream && status_ == "99") return;
  const std::span<Command> pending(pending_.data(), pending_count_);
  const auto answered = std::find(pending.begin(), pending.end(), command_);
  if (answered == pending.end()) return;
  std::move(answered + 1, pending.end(), answered);
  --pending_count_;
}

// False if the number of characters is not that of the echo's beams.
bool Parser::decode_single() noexcept {
  const ScanRequest& request = command_.request();
  const std::size_t beams = request.beams();
  if (data_size_ != beams * request.echo_characters()) return false;
  value_count_ = beams;
  const char* p = data_.data();
  if (request.intensities()) {
    for (std::size_t i = 0; i < beams; ++i, p += 6) {
      ranges_mm_[i] = decode3(p);
      intensities_[i] = decode3(p + 3);
    }
  } else if (request.range_characters() == 3) {
    for (std::size_t i = 0; i < beams; ++i, p += 3) ranges_mm_[i] = decode3(p);
  } else {
    for (std::size_t i = 0; i < beams; ++i, p += 2) ranges_mm_[i] = decode2(p);
  }
  return true;
}

// False unless each beam has 1..kMaxEchoes whole echoes with a '&' before each but the first.
bool Parser::decode_multi() noexcept {
  const ScanRequest& request = command_.request();
  const std::size_t width = request.range_characters();
  const std::size_t step = request.echo_characters();
  std::string_view rest(data_.data(), data_size_);
  std::size_t beams = 0;
  value_count_ = 0;
  while (!rest.empty()) {
    if (rest.front() == '&') {
      if (beams == 0 || echo_counts_[beams - 1] == kMaxEchoes) return false;
      ++echo_counts_[beams - 1];
      rest.remove_prefix(1);
    } else {
      if (beams == request.beams()) return false;
      echo_counts_[beams++] = 1;
    }
    const std::string_view echo = rest.substr(0, step);
    if (echo.size() != step || echo.find('&') != echo.npos) return false;
    ranges_mm_[value_count_] = static_cast<std::uint32_t>(decode(echo.substr(0, width)));
    if (request.intensities()) intensities_[value_count_] = static_cast<std::uint32_t>(decode(echo.substr(width)));
    ++value_count_;
    rest.remove_prefix(step);
  }
  return beams == request.beams();
}

std::string_view name(FaultClass fault) {
  constexpr std::array<std::string_view, kFaultClasses> kNames = {
      "oversize_line", "bad_char",  "bad_echo",  "bad_status",         "bad_sum",
      "bad_line",      "bad_param", "bad_count", "missing_terminator", "truncated"};
  return kNames[static_cast<std::size_t>(fault)];
}

std::string_view name(FaultPlace place) {
  constexpr std::array<std::string_view, 8> kNames = {"echo", "status", "param", "time", "data", "line", "body", "end"};
  return kNames[static_cast<std::size_t>(place)];
}

}  // namespace submapd::driver::scip
