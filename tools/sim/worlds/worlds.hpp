// The built-in worlds: what each is for stands in tools/sim/README.md.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/sim/crowd.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/effects.hpp"
#include "tools/sim/floor.hpp"
#include "tools/sim/motion.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

// A place, a tour through it, and who else is there. Metres; x to the right of the plan, y up.
struct Site {
  std::vector<Segment> walls;
  std::vector<Piece> furniture;  // pieces of the walls that may be moved
  Route route;
  std::vector<Walkway> walkways;
  int people = 0;                                // unless asked otherwise
  double area_m2 = 0.0;                          // of the floor
  double ripple = 0.0;                           // share of the cart's speed, see MotionOptions
  Effects effects = kScannerEffects;             // unless asked otherwise
  std::shared_ptr<const Floor> floor = nullptr;  // nothing: it is level
};

struct BuiltInWorld {
  std::string_view name;
  Site (*build)(std::uint64_t seed);  // the same seed, the same place
};

// In the order in which they are told to people.
[[nodiscard]] std::span<const BuiltInWorld> built_in_worlds();
// Their names: "office, mall, ...".
[[nodiscard]] std::string world_names();

[[nodiscard]] Site build_mall(std::uint64_t seed);
[[nodiscard]] Site build_street(std::uint64_t seed);
[[nodiscard]] Site build_car_park(std::uint64_t seed);
[[nodiscard]] Site build_ring(std::uint64_t seed);
[[nodiscard]] Site build_twin_wings(std::uint64_t seed);
[[nodiscard]] Site build_identical_floors(std::uint64_t seed);
[[nodiscard]] Site build_corridor(std::uint64_t seed);
[[nodiscard]] Site build_corridor_ripple(std::uint64_t seed);
[[nodiscard]] Site build_corridor_braking(std::uint64_t seed);
[[nodiscard]] Site build_ramp(std::uint64_t seed);

}  // namespace submapd::tools
