// A finished sub-map's cells as one dense plane, for code that reads them by the ten thousand.
//
// Built per use and thrown away; a copy, so the sub-map need not outlive it.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/base/floor_to_int.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

inline constexpr double kMaxPlaneExtent_m = 120.0;  // each side; a larger sub-map is refused, not allocated

// What a cell is known as. The limits leave a band of doubt that counts as known and as neither.
enum class CellKind : std::uint8_t { kUnknown, kFree, kDoubtful, kOccupied };

class CellPlane {
 public:
  // Nothing if the sub-map is empty or its extent exceeds kMaxPlaneExtent_m.
  [[nodiscard]] static std::optional<CellPlane> make(const FinishedSubmap& submap);

  // The plane with cells twice as wide, each the most telling kind of the four it covers: occupied, doubtful, free.
  [[nodiscard]] CellPlane halved() const;

  [[nodiscard]] double cell_m() const { return cell_m_; }
  [[nodiscard]] int width() const { return width_; }    // cells
  [[nodiscard]] int height() const { return height_; }  // cells
  [[nodiscard]] std::size_t known_cells() const { return known_cells_; }
  [[nodiscard]] std::size_t bytes() const { return kinds_.capacity() * sizeof(CellKind); }

  // Plane coordinates (0, 0) .. (width - 1, height - 1) of a point in the sub-map's frame; may lie outside.
  [[nodiscard]] Eigen::Vector2i cell_at(const Eigen::Vector2d& point) const {
    return {floor_to_int(point.x() * cells_per_m_) - x0_, floor_to_int(point.y() * cells_per_m_) - y0_};
  }
  // Centre of a cell in the sub-map's frame, m.
  [[nodiscard]] Eigen::Vector2d centre_of(int x, int y) const {
    return {(x + x0_ + 0.5) * cell_m_, (y + y0_ + 0.5) * cell_m_};
  }
  // Lower left corner of cell (0, 0) in the sub-map's frame, m.
  [[nodiscard]] Eigen::Vector2d origin() const { return {x0_ * cell_m_, y0_ * cell_m_}; }

  // REQUIRES: 0 <= y < height().
  [[nodiscard]] std::span<const CellKind> row(int y) const {
    return {&kinds_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_)], static_cast<std::size_t>(width_)};
  }

  // Unknown outside.
  [[nodiscard]] CellKind kind(int x, int y) const {
    if (x < 0 || y < 0 || x >= width_ || y >= height_) {
      return CellKind::kUnknown;
    }
    return kinds_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
  }

  // Whether `wanted` holds for the kind of the cell or of one of its eight neighbours.
  template <typename Wanted>
  [[nodiscard]] bool any_around(const Eigen::Vector2i& cell, const Wanted& wanted) const {
    for (int y = -1; y <= 1; ++y) {
      for (int x = -1; x <= 1; ++x) {
        if (wanted(kind(cell.x() + x, cell.y() + y))) return true;
      }
    }
    return false;
  }

 private:
  int x0_ = 0;  // cell coordinates in the sub-map's frame of plane cell (0, 0)
  int y0_ = 0;
  int width_ = 0;
  int height_ = 0;
  double cell_m_ = 0.05;
  double cells_per_m_ = 20.0;
  std::size_t known_cells_ = 0;
  std::vector<CellKind> kinds_;
};

}  // namespace submapd
