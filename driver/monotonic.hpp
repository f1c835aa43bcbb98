// The clock of all host times in the driver.
#pragma once

#include <cstdint>
#include <ctime>

namespace submapd::driver {

// CLOCK_MONOTONIC. Any thread.
[[nodiscard]] inline std::int64_t monotonic_now_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

}  // namespace submapd::driver
