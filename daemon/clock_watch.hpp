// Notices that somebody set the system's clock. A value; one thread.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <optional>

namespace submapd {

class ClockWatch {
 public:
  // Slewing by a time server moves the clock by less than this between two looks.
  static constexpr std::int64_t kStep_ns = 500'000'000;

  explicit ClockWatch(std::int64_t system_offset_ns) : offset_ns_(system_offset_ns) {}
  // The step since the last look, if there was one. `system_offset_ns`: RunClock's.
  [[nodiscard]] std::optional<std::int64_t> look(std::int64_t system_offset_ns) {
    const std::int64_t step_ns = system_offset_ns - offset_ns_;
    offset_ns_ = system_offset_ns;
    return std::abs(step_ns) >= kStep_ns ? std::optional(step_ns) : std::nullopt;
  }

 private:
  std::int64_t offset_ns_;
};

}  // namespace submapd
