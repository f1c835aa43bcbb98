// An odometry_t message from anyone as a value: CART_ODOMETRY.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "slam/base/ids.hpp"
#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd {

struct OdometryMessage {
  std::int64_t utime_us = 0;  // system's wall clock; 0: when the message came
  Uuid cart;                  // zeros: not said
  Pose2 odom_from_base;
};

// Errors: kCorrupt (not an odometry_t, or values no cart has).
[[nodiscard]] Expected<OdometryMessage> decode_odometry(std::span<const std::byte> bytes);

}  // namespace submapd
