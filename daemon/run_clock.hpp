// Wall clock of a run: the monotonic clock plus an offset that is frozen when the run starts or goes on (design
// section 6).
//
// Steps of the system's clock later on never reach a stamp. When scans come from a log, its newest scan is what time it
// is. A value; any thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>

#include "driver/monotonic.hpp"

namespace submapd {

inline constexpr std::int64_t kSecond_ns = 1'000'000'000;

class RunClock {
 public:
  explicit RunClock(std::int64_t wall_minus_mono_ns) : offset_ns_(wall_minus_mono_ns) {}
  // `now_ns` stands for the monotonic clock.
  explicit RunClock(std::shared_ptr<const std::atomic<std::int64_t>> now_ns) : virtual_now_ns_(std::move(now_ns)) {}
  [[nodiscard]] static RunClock now() { return RunClock(system_offset_ns()); }
  // The same, but never before an instant of this run: the system's clock may have lost the time with its power.
  [[nodiscard]] static RunClock now_after(std::int64_t utime_us) {
    return RunClock(std::max(system_offset_ns(), utime_us * 1000 - driver::monotonic_now_ns()));
  }
  // The system's clock less the monotonic one, this very moment.
  [[nodiscard]] static std::int64_t system_offset_ns() {
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(wall).count() - driver::monotonic_now_ns();
  }

  [[nodiscard]] std::int64_t now_ns() const {
    return virtual_now_ns_ ? virtual_now_ns_->load(std::memory_order_relaxed) : driver::monotonic_now_ns();
  }
  [[nodiscard]] std::int64_t utime_us(std::int64_t mono_ns) const { return (mono_ns + offset_ns_) / 1000; }
  [[nodiscard]] std::int64_t utime_us() const { return utime_us(now_ns()); }
  [[nodiscard]] std::int64_t offset_ns() const { return offset_ns_; }
  [[nodiscard]] bool is_virtual() const { return virtual_now_ns_ != nullptr; }

 private:
  std::int64_t offset_ns_ = 0;
  std::shared_ptr<const std::atomic<std::int64_t>> virtual_now_ns_;
};

}  // namespace submapd
