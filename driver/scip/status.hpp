// The two-character status of a SCIP reply: what it means for the command that it answers, and the words of the manual.
//
// Plain values, any thread, no allocation. Sources: SCIP 2.0 specification C-42-03320B, UXM-30LX-EW specification
// C-42-03907, UST specification C-42-04076.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace submapd::driver::scip {

class ReplyStatus {
 public:
  ReplyStatus() = default;
  explicit ReplyStatus(std::string_view text);  // of 1 (SCIP 1.1) or 2 characters; more are cut

  [[nodiscard]] std::string_view text() const { return {text_.data(), size_}; }
  friend bool operator==(const ReplyStatus& status, std::string_view text) { return status.text() == text; }

 private:
  std::array<char, 2> text_{};
  std::uint8_t size_ = 0;
};

// What the driver does about a status depends on nothing but this.
enum class StatusMeaning : std::uint8_t {
  kOk,
  kData,             // 99: a scan of a stream follows
  kAlready,          // what was asked for is so already: as good as kOk
  kBadParameter,     // the command's parameters are refused
  kNotSupported,     // this model does not know the command, or not in this form
  kLaserOff,         // G*, H* before BM
  kDenied,           // not in the present state, e.g. measuring
  kTimeModeOff,      // TM1 before TM0
  kPaused,           // 21..49: the stream stopped to check an error; wait for 98 or 50..97
  kResumed,          // 98: the check found nothing, scans go on
  kHardwareTrouble,  // 50..97, BM 01: laser or motor; the stream is over, reset the sensor
  kAbnormal,         // 0L: left only by reboot or power cycle
  kUnstable,         // 0M: e.g. the motor is spinning up
  kInternalError,    // 0A, 0B: ask again
  kFirmwareUpdate,   // 0I: waits for new firmware
  kUnknown,
};

// `command`: the echo of the reply. The words are static.
struct StatusInfo {
  StatusMeaning meaning = StatusMeaning::kUnknown;
  std::string_view words;
};
[[nodiscard]] StatusInfo explain(std::string_view command, const ReplyStatus& status);

// What the text behind STAT in the answer to II says of the sensor's health.
enum class Health : std::uint8_t {
  kWorking,
  kTrouble,  // says so itself: "Trouble!! Error No. ..."
  kUnknown,  // a text that no sensor known to us sends: log it
};
[[nodiscard]] Health health_of(std::string_view stat_text);

}  // namespace submapd::driver::scip
