#include "driver/clock/usb_grid.hpp"

#include <algorithm>
#include <cstddef>

namespace submapd::driver {

double measure_usb_grid_us(std::span<const std::int64_t> received_mono_ns) {
  constexpr std::int64_t kFrame_ns = 1'000'000;
  constexpr std::int64_t kWakeUp_ns = 150'000;
  constexpr std::size_t kEnough = 20;
  if (received_mono_ns.size() < kEnough) return 1000.0;
  std::size_t on_frames = 0;
  for (std::size_t i = 1; i < received_mono_ns.size(); ++i) {
    const std::int64_t phase_ns = (received_mono_ns[i] - received_mono_ns[i - 1]) % kFrame_ns;
    on_frames += std::min(phase_ns, kFrame_ns - phase_ns) <= kWakeUp_ns ? 1 : 0;
  }
  // By chance 3 of 10 are so near to whole frames; on a grid of frames all are but the late ones and those behind them.
  return 2 * on_frames > received_mono_ns.size() ? 1000.0 : 125.0;
}

}  // namespace submapd::driver
