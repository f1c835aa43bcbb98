// The simulator's plans from any bytes: no crash, nothing but finite walls and way-points, maps as large as they say.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "tools/sim/floor_plan.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (const auto walls = submapd::tools::parse_wall_csv(text, "fuzz")) {
    for (const submapd::tools::Segment& wall : *walls) {
      if (!wall.a.allFinite() || !wall.b.allFinite()) std::abort();
    }
  }
  if (const auto waypoints = submapd::tools::parse_waypoints(text, "fuzz")) {
    for (const Eigen::Vector2d& point : *waypoints) {
      if (!point.allFinite()) std::abort();
    }
  }
  if (const auto map = submapd::tools::parse_pgm(text, "fuzz", 0.05)) {
    if (map->grey.size() != static_cast<std::size_t>(map->width) * static_cast<std::size_t>(map->height)) std::abort();
    // Walls are found on maps of any size; a huge one only takes its time.
    if (map->grey.size() < 10'000) (void)submapd::tools::outline(*map, &submapd::tools::GreyMap::wall);
  }
  return 0;
}
