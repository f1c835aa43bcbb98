// What the parser finds in a sensor's bytes: scans, replies and faults.
//
// Views in an event live until the callback returns. Times are those that the caller gave with the bytes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "driver/scip/command.hpp"
#include "driver/scip/encode.hpp"
#include "driver/scip/status.hpp"

namespace submapd::driver::scip {

// What every undamaged frame has.
struct Frame {
  std::string_view echo;
  ReplyStatus status;
  std::int64_t first_byte_ns = 0;  // arrival of the bytes with the first character of the echo
  std::int64_t last_byte_ns = 0;   // ... with the blank line that ends the frame
};

// One scan. Raw values: below DMIN a range is an error code.
struct ScanData {
  Frame frame;
  ScanRequest request;                              // of the echo: request.number is the count of scans still to come
  std::uint64_t time = 0;                           // ms modulo 2^24; with request.microseconds us
  std::span<const std::uint32_t> ranges_mm = {};    // all echoes of all beams in order
  std::span<const std::uint32_t> intensities = {};  // as ranges_mm, or empty
  std::span<const std::uint8_t> echo_counts = {};   // echoes of each beam; empty unless request.multi_echo()
};

enum class FaultClass : std::uint8_t {
  kOversizeLine,
  kBadChar,    // a byte that cannot stand there
  kBadEcho,    // not a command that was sent
  kBadStatus,  // the status line has the wrong length
  kBadSum,
  kBadLine,            // a line of the wrong length, or where none belongs
  kBadParam,           // not KEY:value;S
  kBadCount,           // other values than the echo promises
  kMissingTerminator,  // the next echo came before the blank line
  kTruncated,          // silence inside a frame
};
inline constexpr std::size_t kFaultClasses = 10;

enum class FaultPlace : std::uint8_t { kEcho, kStatus, kParam, kTime, kData, kLine, kBody, kEnd };

struct Fault {
  FaultClass fault = FaultClass::kBadChar;
  FaultPlace place = FaultPlace::kEcho;
  std::uint32_t line = 0;       // 0-based in its frame
  bool in_scan = false;         // the frame carried a scan, which is lost
  std::int64_t arrival_ns = 0;  // of the bytes that showed the fault
};

// Names as in scip_vectors.json, e.g. "bad_sum", "status".
[[nodiscard]] std::string_view name(FaultClass fault);
[[nodiscard]] std::string_view name(FaultPlace place);

// Receives the events in the order of the bytes, on the thread that calls Parser::feed(). A callback may call
// Parser::expect() and forget(), not feed(), end() or reset().
class Listener {
 public:
  virtual void on_scan(const ScanData& scan) noexcept = 0;
  // A scan of a stream that QT, RS or RT has ended: normal, not to be used.
  virtual void on_stale_scan(const ScanData& scan) noexcept = 0;
  // A stream was accepted (status 00).
  virtual void on_stream_start(const Frame& frame) noexcept = 0;
  // A status of the running stream that is neither 00 nor 99: paused, resumed, hardware trouble.
  virtual void on_stream_status(const Frame& frame) noexcept = 0;
  // TM1, %TM1: the sensor's clock, in ms modulo 2^24 or in us.
  virtual void on_time(const Frame& frame, std::uint64_t time) noexcept = 0;
  // Everything else, also refusals of the commands above. `parameters` is empty unless VV, PP or II was answered by 00.
  virtual void on_reply(const Frame& frame, std::span<const Parameter> parameters) noexcept = 0;
  // One for each damaged frame; it gives no other event.
  virtual void on_fault(const Fault& fault) noexcept = 0;

 protected:
  ~Listener() = default;
};

}  // namespace submapd::driver::scip
