// Wall clock of a run: the monotonic clock plus an offset that is frozen when the run starts (design section 6).
//
// Steps of the system's clock later on never reach a stamp. A value; any thread.
#pragma once

#include <chrono>
#include <cstdint>

#include "driver/monotonic.hpp"

namespace submapd {

class RunClock {
 public:
  explicit RunClock(std::int64_t wall_minus_mono_ns) : offset_ns_(wall_minus_mono_ns) {}
  [[nodiscard]] static RunClock now() {
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    return RunClock(std::chrono::duration_cast<std::chrono::nanoseconds>(wall).count() - driver::monotonic_now_ns());
  }

  [[nodiscard]] std::int64_t utime_us(std::int64_t mono_ns) const { return (mono_ns + offset_ns_) / 1000; }
  [[nodiscard]] std::int64_t utime_us() const { return utime_us(driver::monotonic_now_ns()); }
  [[nodiscard]] std::int64_t offset_ns() const { return offset_ns_; }

 private:
  std::int64_t offset_ns_;
};

}  // namespace submapd
