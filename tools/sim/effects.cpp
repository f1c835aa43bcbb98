#include "tools/sim/effects.hpp"

#include <fmt/format.h>

#include <string_view>
#include <utility>

namespace submapd::tools {
namespace {

constexpr std::pair<std::string_view, bool Effects::*> kNames[] = {
    {"mixed", &Effects::mixed}, {"bias", &Effects::bias},   {"clock", &Effects::clock},
    {"lost", &Effects::lost},   {"jerky", &Effects::jerky}, {"moved", &Effects::moved},
};

}  // namespace

Expected<Effects> parse_effects(const std::string& list) {
  Effects effects;
  std::string_view rest = list;
  while (!rest.empty() && list != "none") {
    const std::string_view name = rest.substr(0, rest.find(','));
    rest.remove_prefix(std::min(rest.size(), name.size() + 1));
    bool known = false;
    for (const auto& [effect, member] : kNames) {
      if (name == effect || name == "all") {
        effects.*member = true;
        known = true;
      }
    }
    if (!known) {
      return failure(
          StatusCode::kInvalidArgument,
          fmt::format("effects: {} is none; there are mixed, bias, clock, lost, jerky, moved, all, none", name));
    }
  }
  return effects;
}

void apply(const Effects& effects, MotionOptions& motion) {
  if (effects.jerky) {
    motion.acceleration_m_s2 = 1.8;
    motion.jerk_m_s3 = 8.0;
    motion.wobble_rad = 0.035;
    motion.cadence_ripple = 0.03;
    motion.stop_every_m = 20.0;
  }
}

void apply(const Effects& effects, SensorOptions& sensor) {
  sensor.mixed_pixels = effects.mixed ? 0.3 : 0.0;
  sensor.range_bias_m = effects.bias ? 0.020 : 0.0;
  sensor.clock_ppm = effects.clock ? 100.0 : 0.0;
  sensor.lost_scans = effects.lost ? 0.005 : 0.0;
}

}  // namespace submapd::tools
