// When a run's cart stood, by the poses that were spooled: nothing is learnt from mapping hours of one view again.
#pragma once

#include <cstdint>
#include <vector>

#include "slam/output/pose_spool.hpp"

namespace submapd {

// Scans stamped from `first_us` to `last_us` were taken at one place, and no key-frame is among them.
struct Standstill {
  std::int64_t first_us = 0;
  std::int64_t last_us = 0;

  [[nodiscard]] bool contains(std::int64_t stamp_us) const { return stamp_us >= first_us && stamp_us <= last_us; }
};

// Those after `after_us`, in order of time, without their first and last two seconds, in which the cart may have come
// or gone. Shorter ones than ten seconds do not count. At one place: within what makes no key-frame however long it
// takes, 1.5 cm and 0.6 deg. Errors: those of the spool.
[[nodiscard]] Expected<std::vector<Standstill>> find_standstills(const PoseSpool& poses, std::int64_t after_us);

}  // namespace submapd
