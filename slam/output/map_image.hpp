// The whole map as one grid of occupancy bytes: what map.pgm and map.png are made of.
//
// Frame: the map's, axes along the grid's. Value type.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "slam/base/status.hpp"

namespace submapd {

struct MapImage {
  double cell_m = 0.05;
  double origin_x_m = 0.0;  // lower-left corner of cell (0, 0)
  double origin_y_m = 0.0;
  int width = 0;   // cells along x
  int height = 0;  // cells along y
  // Row-major, width * height, row 0 at the lowest y; 0 unknown, else occupancy_of() (finished_submap.hpp).
  std::vector<std::uint8_t> cells;

  // REQUIRES: 0 <= x < width, 0 <= y < height.
  [[nodiscard]] std::uint8_t at(int x, int y) const {
    return cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)];
  }
};

// Whether the fields agree with each other: at least one cell, as many bytes as cells, finite and sensible lengths.
[[nodiscard]] Status check_map_image(const MapImage& map);

}  // namespace submapd
