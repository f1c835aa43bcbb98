// Whether an LCM instance hears anything.
#pragma once

#include <lcm/lcm-cpp.hpp>

namespace submapd {

// Ask before subscribing: LCM tries its self test only when something is to be received, and if a packet filter stops
// that, it subscribes to nothing and returns a null pointer.
[[nodiscard]] inline bool can_receive(lcm::LCM& lcm) {
  return lcm.good() && lcm.getFileno() >= 0;
}

}  // namespace submapd
