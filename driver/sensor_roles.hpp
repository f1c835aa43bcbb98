// Which scanner is the horizontal one and which the vertical one: by what the configuration says, never by guessing.
//
// Two scanners of one model look the same on USB. What tells them apart is the serial number that they answer to VV
// with, or, if the configuration says so, the port that they are plugged into. Pure values; any thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "driver/error.hpp"

namespace submapd::driver {

enum class SensorRole : std::uint8_t { kHorizontal, kVertical };
inline constexpr std::size_t kSensorRoles = 2;
[[nodiscard]] constexpr char letter_of(SensorRole role) {
  return role == SensorRole::kHorizontal ? 'H' : 'V';
}

struct RoleRule {
  std::string serial;  // as printed on the case or as sent: H0903971 and 00903971 are the same; empty: by port
  std::string port;    // bus and port chain, e.g. "1-1.2", used if serial is empty; both empty: nobody has this role
};
using RoleRules = std::array<RoleRule, kSensorRoles>;  // by SensorRole

// Who asks for a role.
struct SensorIdentity {
  std::string serial;
  std::string product;
  std::string firmware;
  std::string port;
};

// True if both mean the same scanner. The maker prints an H where the sensor sends a leading 0.
[[nodiscard]] bool same_serial(std::string_view a, std::string_view b);

// The role of a scanner. kNotFound if the rules do not name it, kInvalidArgument if they give it two roles; the message
// says which command settles it. `present`: all scanners that are plugged in, to name them in that message.
[[nodiscard]] Expected<SensorRole> find_role(const RoleRules& rules, const SensorIdentity& sensor,
                                             std::span<const std::string> present);

}  // namespace submapd::driver
