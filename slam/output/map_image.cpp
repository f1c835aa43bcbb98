#include "slam/output/map_image.hpp"

#include <fmt/format.h>

#include <cmath>

namespace submapd {

Status check_map_image(const MapImage& map) {
  if (map.width <= 0 || map.height <= 0) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the map has no cells ({} x {}): insert scans first", map.width, map.height));
  }
  if (map.cells.size() != static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height)) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the map of {} x {} cells holds {} bytes", map.width, map.height, map.cells.size()));
  }
  if (!std::isfinite(map.cell_m) || map.cell_m < 1e-6 || !std::isfinite(map.origin_x_m) ||
      !std::isfinite(map.origin_y_m)) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the map's cell size {} m or origin ({}, {}) m is no length", map.cell_m, map.origin_x_m,
                              map.origin_y_m));
  }
  return {};
}

}  // namespace submapd
