#include "slam/loop/cell_plane.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace submapd {
namespace {

constexpr double kOccupiedFrom = 0.7;
constexpr double kFreeBelow = 0.12;  // five looks through it without a hit, equation (8)

std::array<CellKind, 256> kind_table() {
  std::array<CellKind, 256> table{};
  for (int byte = 1; byte < 256; ++byte) {
    const double occupancy = occupancy_of(static_cast<std::uint8_t>(byte));
    table[static_cast<std::size_t>(byte)] = occupancy > kOccupiedFrom ? CellKind::kOccupied
                                            : occupancy < kFreeBelow  ? CellKind::kFree
                                                                      : CellKind::kDoubtful;
  }
  return table;
}

}  // namespace

std::optional<CellPlane> CellPlane::make(const FinishedSubmap& submap) {
  if (submap.blocks.empty() || !(submap.cell_m > 0.0)) {
    return std::nullopt;
  }
  std::int64_t bx_min = std::numeric_limits<std::int32_t>::max();
  std::int64_t by_min = bx_min;
  std::int64_t bx_max = std::numeric_limits<std::int32_t>::min();
  std::int64_t by_max = bx_max;
  for (const OccupancyBlock& block : submap.blocks) {
    bx_min = std::min<std::int64_t>(bx_min, block.bx);
    by_min = std::min<std::int64_t>(by_min, block.by);
    bx_max = std::max<std::int64_t>(bx_max, block.bx);
    by_max = std::max<std::int64_t>(by_max, block.by);
  }
  const auto limit = static_cast<std::int64_t>(kMaxPlaneExtent_m / submap.cell_m);
  const std::int64_t width = (bx_max - bx_min + 1) * kBlockCells;
  const std::int64_t height = (by_max - by_min + 1) * kBlockCells;
  const bool far_away = std::max({std::abs(bx_min), std::abs(by_min), std::abs(bx_max), std::abs(by_max)}) > (1 << 20);
  if (width > limit || height > limit || far_away) {
    return std::nullopt;
  }
  CellPlane plane;
  plane.cell_m_ = submap.cell_m;
  plane.cells_per_m_ = 1.0 / submap.cell_m;
  plane.x0_ = static_cast<int>(bx_min * kBlockCells);
  plane.y0_ = static_cast<int>(by_min * kBlockCells);
  plane.width_ = static_cast<int>(width);
  plane.height_ = static_cast<int>(height);
  plane.kinds_.assign(static_cast<std::size_t>(width * height), CellKind::kUnknown);
  static const std::array<CellKind, 256> kTable = kind_table();
  for (const OccupancyBlock& block : submap.blocks) {
    const std::int64_t x = (block.bx - bx_min) * kBlockCells;
    for (std::int64_t cy = 0; cy < kBlockCells; ++cy) {
      const std::int64_t y = (block.by - by_min) * kBlockCells + cy;
      CellKind* row = &plane.kinds_[static_cast<std::size_t>(y * width + x)];
      for (std::int64_t cx = 0; cx < kBlockCells; ++cx) {
        row[cx] = kTable[block.cells[static_cast<std::size_t>(cy * kBlockCells + cx)]];
        plane.known_cells_ += row[cx] != CellKind::kUnknown ? 1 : 0;
      }
    }
  }
  return plane;
}

CellPlane CellPlane::halved() const {
  // Planes consist of whole blocks, so that first cell and extent are even.
  static_assert(kBlockCells % 2 == 0);
  CellPlane half;
  half.cell_m_ = 2.0 * cell_m_;
  half.cells_per_m_ = 0.5 * cells_per_m_;
  half.x0_ = x0_ / 2;
  half.y0_ = y0_ / 2;
  half.width_ = width_ / 2;
  half.height_ = height_ / 2;
  const auto width = static_cast<std::size_t>(half.width_);
  const auto height = static_cast<std::size_t>(half.height_);
  half.kinds_.resize(width * height);
  for (std::size_t y = 0; y < height; ++y) {
    const CellKind* low = &kinds_[4 * y * width];
    const CellKind* high = low + 2 * width;
    for (std::size_t x = 0; x < width; ++x) {
      const CellKind kind = std::max(std::max(low[2 * x], low[2 * x + 1]), std::max(high[2 * x], high[2 * x + 1]));
      half.kinds_[y * width + x] = kind;
      half.known_cells_ += kind != CellKind::kUnknown ? 1 : 0;
    }
  }
  return half;
}

}  // namespace submapd
