// Where in a sub-map a scan was taken, if nobody followed the cart there (after a restart).
//
// Seeks as far as the cart can have come, in every direction it can face by then. A wrong place would bend the map, a
// place not found costs a link only: what fits badly, or at two places, is none.
#pragma once

#include <optional>

#include "slam/filter/internal/scan_registration.hpp"

namespace submapd {

// `scan` holds the scan's points; `last` is where the cart was `gap_s` ago, in the map's frame. Allocates.
[[nodiscard]] std::optional<MatchResult> relocalise(const ScanRegistration& scan, const MapperOptions& options,
                                                    const MapView& view, const Pose2& last, double gap_s);

}  // namespace submapd
