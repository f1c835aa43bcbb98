// The built-in world: a furnished office floor of 40 x 25 m and a tour through it.
//
// Three cross corridors between two long ones make rings; twenty rooms, each furnished differently. What the laser sees at
// its height is drawn: legs of desks and chairs, cabinets, pillars, boxes in the corridors.
#pragma once

#include "tools/sim/motion.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

[[nodiscard]] World office_world();

// A closed tour of about 330 m through all corridors and most rooms; it passes most corridors more than once.
[[nodiscard]] Route office_tour();

}  // namespace submapd::tools
