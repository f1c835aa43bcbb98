// Score plane of a sub-map and its pyramid of upper bounds (Olson 2009; design notes 9.1).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slam/loop/cell_plane.hpp"
#include "slam/loop/surface_index.hpp"

namespace submapd::internal {

inline constexpr int kMaxPyramidLevel = 6;
inline constexpr int kScoreReach = 5;  // cells; farther from what is occupied the score rounds to nothing

// Where a search point lies, in plane cells, before the offset of a candidate is added.
struct PointCell {
  std::int16_t x = 0;
  std::int16_t y = 0;
};

// Search points by where the offsets to be tried take them.
struct PointCells {
  std::span<const PointCell> inside;  // never off the plane: 0 <= point + offset < its extent
  std::span<const PointCell> border;  // perhaps
};

// Level 0 holds 255 * exp(-D^2 / (2 sigma^2)), D the distance in cells to the closest occupied cell, sigma 1.5 cells.
// Level h holds at (x, y) a bound of level 0 over [x, x + 2^h) x [y, y + 2^h): exact up to level 2, above that stored
// at stride 2^(h-2), where an entry bounds every x that shares it. All levels together take 3.4 times level 0.
class MatchGrid {
 public:
  // Surface means count as occupied as well: at a distance sparse scans leave walls with holes.
  MatchGrid(const CellPlane& plane, const SurfaceIndex& surface, int levels);

  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }

  // Sum over the points of level `level` at (point + (x, y)).
  [[nodiscard]] std::int32_t sum(int level, const PointCells& points, int x, int y) const;

  // The four sums at (x, y), (x + step, y), (x, y + step), (x + step, y + step), step a multiple of the level's stride:
  // the children of a node in one pass, twice as fast as four. All four are offsets of points.inside.
  [[nodiscard]] std::array<std::int32_t, 4> sum4(int level, const PointCells& points, int x, int y, int step) const;

  // Value of one cell of a level at level-0 coordinates.
  [[nodiscard]] std::uint8_t value(int level, int x, int y) const;

 private:
  struct Level {
    int shift = 0;  // log2 of the stride
    int bias = 0;   // stored column of coordinate 0: windows that only reach into the plane begin before it
    int width = 0;
    int height = 0;
    std::vector<std::uint8_t> values;
    [[nodiscard]] std::uint8_t at(int column, int row) const {
      const bool inside = static_cast<unsigned>(column) < static_cast<unsigned>(width) &&
                          static_cast<unsigned>(row) < static_cast<unsigned>(height);
      return inside ? values[static_cast<std::size_t>(row * width + column)] : std::uint8_t{0};
    }
  };
  static Level score_plane(const CellPlane& plane, const SurfaceIndex& surface);
  static Level coarser(const Level& fine, int level);

  std::vector<Level> levels_;
};

}  // namespace submapd::internal
