// One SCIP 2.0 command as text, and what its answer must look like.
//
// A plain value of fixed size: copying it never allocates. Any thread. Source: SCIP 2.0 specification C-42-03320B and
// the UXM/UST specifications for N*, H* and '%' commands.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace submapd::driver::scip {

// Shape of the answer.
enum class CommandKind : std::uint8_t {
  kOther,       // a status and nothing else: BM QT RS RT TM0 TM2 SS CR HS DB RB SCIP2.0 ...
  kParameters,  // VV PP II: lines KEY:value
  kTime,        // TM1 %TM1: one line with the sensor's clock
  kScanOnce,    // G* H*: one scan with status 00
  kScanStream,  // M* N* and %M* %N*: an acknowledgement 00, then scans with status 99
};

// Parameters of a scan command, as it carries them.
struct ScanRequest {
  bool microseconds = false;  // '%': 11-character time in microseconds
  char mode = 'M';            // M, N: stream; G, H: the latest scan; N, H: several echoes a beam
  char data = 'D';            // D: range in 3 characters; S: in 2; E: range and intensity, 3 each
  int first_step = 0;         // 0..9999
  int last_step = 1080;       // 0..9999
  int cluster = 1;            // 0..99 neighbouring steps give one value; 0 and 1: each its own
  int interval = 0;           // 0..9 scans skipped between two that are sent; streams only
  int number = 0;             // 0..99 scans; 0: until QT; streams only

  [[nodiscard]] bool streams() const { return mode == 'M' || mode == 'N'; }
  [[nodiscard]] bool multi_echo() const { return mode == 'N' || mode == 'H'; }
  [[nodiscard]] bool intensities() const { return data == 'E'; }
  [[nodiscard]] std::size_t range_characters() const { return data == 'S' ? 2 : 3; }
  // Characters of one echo: its range, and its intensity if there is one.
  [[nodiscard]] std::size_t echo_characters() const { return range_characters() * (intensities() ? 2 : 1); }
  // Values that one scan holds; 0 if the steps are in the wrong order.
  [[nodiscard]] std::size_t beams() const;
  friend bool operator==(const ScanRequest&, const ScanRequest&) = default;
};

class Command {
 public:
  static constexpr std::size_t kCapacity = 40;  // longest: '%', 15 characters, ';' and a string of 16

  Command() = default;

  // Any printable text, also commands unknown to us. Nothing if it is empty, too long or not printable. No line feed.
  static std::optional<Command> parse(std::string_view text);

  // REQUIRES: request's fields in their ranges (else the digits are cut); tag of at most 16 characters.
  // `tag` is sent as ";tag" and comes back in each echo: it tells a reply from an older one.
  static Command scan(const ScanRequest& request, std::string_view tag = {});

  [[nodiscard]] std::string_view text() const { return {text_.data(), size_}; }
  [[nodiscard]] CommandKind kind() const { return kind_; }
  // Meaningful for kScanOnce and kScanStream.
  [[nodiscard]] const ScanRequest& request() const { return request_; }

  // True if both are the same scan stream: the same up to the two digits that count the scans still to come.
  // REQUIRES: both are kScanStream.
  [[nodiscard]] bool same_stream(const Command& other) const;

  friend bool operator==(const Command& a, const Command& b) { return a.text() == b.text(); }

 private:
  void append(std::string_view text);
  void append_digits(int value, int digits);
  void classify();

  std::array<char, kCapacity> text_{};
  std::uint8_t size_ = 0;
  CommandKind kind_ = CommandKind::kOther;
  ScanRequest request_;
};

}  // namespace submapd::driver::scip
