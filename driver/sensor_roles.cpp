#include "driver/sensor_roles.hpp"

#include <optional>

namespace submapd::driver {
namespace {

std::string_view without_first(std::string_view serial) {
  const bool marked = !serial.empty() && (serial.front() == 'H' || serial.front() == '0');
  return marked ? serial.substr(1) : serial;
}

std::string command_to_settle(std::span<const std::string> present) {
  std::string serials;
  for (const std::string& serial : present) {
    serials += serials.empty() ? "" : ", ";
    serials += serial;
  }
  return "; plugged in: " + (serials.empty() ? "none" : serials) +
         ". Say which is which with: submapctl sensors --assign H=SERIAL V=SERIAL (V may be left out)";
}

}  // namespace

bool same_serial(std::string_view a, std::string_view b) {
  return a == b || (a.size() == b.size() && a.size() > 1 && without_first(a) == without_first(b) &&
                    without_first(a).size() == a.size() - 1 && without_first(b).size() == b.size() - 1);
}

Expected<SensorRole> find_role(const RoleRules& rules, const SensorIdentity& sensor,
                               std::span<const std::string> present) {
  std::optional<SensorRole> found;
  // A serial number anywhere beats a port: it is the scanner itself and not where somebody plugged it in.
  for (const bool by_serial : {true, false}) {
    for (const SensorRole role : {SensorRole::kHorizontal, SensorRole::kVertical}) {
      const RoleRule& rule = rules[static_cast<std::size_t>(role)];
      const bool matches = by_serial ? !rule.serial.empty() && same_serial(rule.serial, sensor.serial)
                                     : rule.serial.empty() && !rule.port.empty() && rule.port == sensor.port;
      if (!matches) {
        continue;
      }
      if (found) {
        return failure(ErrorCode::kInvalidArgument, "scanner " + sensor.serial + " at port " + sensor.port +
                                                        " is configured as H and as V" + command_to_settle(present));
      }
      found = role;
    }
    if (found) {
      return *found;
    }
  }
  return failure(ErrorCode::kNotFound,
                 "scanner " + sensor.serial + " at port " + sensor.port + " has no role" + command_to_settle(present));
}

}  // namespace submapd::driver
