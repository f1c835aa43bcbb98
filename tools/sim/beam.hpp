// What one laser beam meets on its way: matt walls, panes of glass, mirrors, people.
#pragma once

#include <optional>
#include <span>

#include "slam/base/random.hpp"
#include "tools/sim/crowd.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

struct Echo {
  double range_m = 0.0;        // along the beam's whole way, reflections included
  double cos_incidence = 0.0;  // 1: the surface is met head on; 0: grazing
};

// People's discs hold at time_s after they were gathered. Glass answers where it is met within 4 degrees of its normal;
// else the beam goes through, or is reflected with Fresnel's share (Schlick 1994, both faces of a pane). A mirror
// always reflects. `random` is asked only at glass. REQUIRES: direction of unit length.
[[nodiscard]] std::optional<Echo> trace(const World& world, std::span<const Disc> people, double time_s,
                                        const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
                                        double range_max_m, CounterRandom& random);

}  // namespace submapd::tools
