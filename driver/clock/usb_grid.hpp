// How finely USB hands out the sensor's bytes: every 1 ms (full-speed host controllers) or every 125 us (xHCI).
//
// Pure function, any thread, no allocation.
#pragma once

#include <cstdint>
#include <span>

namespace submapd::driver {

// The grid, 1000 or 125 us, that the arrivals of TM1 replies show: the time between two of them is a multiple of it,
// but for the host's wake-up. 1000, the cautious one, unless at least 20 replies clearly do not keep to it.
// ClockOptions::usb_grid_us rests on this.
[[nodiscard]] double measure_usb_grid_us(std::span<const std::int64_t> received_mono_ns);

}  // namespace submapd::driver
