// Cells, blocks and the dense directory of a sub-map's index map (paper 2.2, design notes 4.1).
//
// A sub-map's frame is covered by 64 x 64 blocks of 64 x 64 cells, its origin in the middle. Cell (ix, iy) holds the
// points with floor(x / cell_m) + 2048 == ix; indices are never negative, so that block and offset are a shift and a
// mask.
#pragma once

#include <cmath>
#include <cstdint>

#include "slam/submap/finished_submap.hpp"

namespace submapd {

inline constexpr int kDirectoryBlocks = 64;                                 // blocks along one side
inline constexpr int kDirectorySize = kDirectoryBlocks * kDirectoryBlocks;  // blocks in all
inline constexpr int kMapCells = kDirectoryBlocks * kBlockCells;            // cells along one side
inline constexpr int kMapBias = kMapCells / 2;                              // index of the cell at the origin
inline constexpr int kBlockArea = kBlockCells * kBlockCells;                // cells in a block

struct CellIndex {
  int ix = 0;
  int iy = 0;
  friend bool operator==(const CellIndex&, const CellIndex&) = default;
};

[[nodiscard]] inline bool in_map(CellIndex c) {
  return c.ix >= 0 && c.iy >= 0 && c.ix < kMapCells && c.iy < kMapCells;
}
// Cell of a point [m]; may lie outside the map: check with in_map().
[[nodiscard]] inline CellIndex cell_at(double x_m, double y_m, double cells_per_m) {
  const double limit = 1e6;  // keeps the conversion defined for any finite input
  const double u = std::fmin(std::fmax(std::floor(x_m * cells_per_m), -limit), limit);
  const double v = std::fmin(std::fmax(std::floor(y_m * cells_per_m), -limit), limit);
  return {static_cast<int>(u) + kMapBias, static_cast<int>(v) + kMapBias};
}
// REQUIRES: in_map(c).
[[nodiscard]] inline int block_of(CellIndex c) {
  return (c.iy >> 6) * kDirectoryBlocks + (c.ix >> 6);
}
[[nodiscard]] inline int offset_of(CellIndex c) {
  return ((c.iy & 63) << 6) | (c.ix & 63);
}

}  // namespace submapd
