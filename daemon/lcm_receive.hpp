// Whether an LCM instance hears anything, and what it hears.
#pragma once

#include <cstddef>
#include <lcm/lcm-cpp.hpp>
#include <span>

namespace submapd {

// Ask before subscribing: LCM tries its self test only when something is to be received, and if a packet filter stops
// that, it subscribes to nothing and returns a null pointer.
[[nodiscard]] inline bool can_receive(lcm::LCM& lcm) {
  return lcm.good() && lcm.getFileno() >= 0;
}

// As long as LCM keeps the buffer: during the call that hands it over.
[[nodiscard]] inline std::span<const std::byte> bytes_of(const lcm::ReceiveBuffer* buffer) {
  return {static_cast<const std::byte*>(buffer->data), buffer->data_size};
}

}  // namespace submapd
