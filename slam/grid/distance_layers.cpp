#include "slam/grid/distance_layers.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace submapd {
namespace {

constexpr int kKernelSide = 2 * kDistanceRadiusCells + 1;

struct StampKernel {
  std::array<std::array<std::uint8_t, kKernelSide>, kKernelSide> rows{};
  StampKernel() {
    for (int dy = 0; dy < kKernelSide; ++dy) {
      for (int dx = 0; dx < kKernelSide; ++dx) {
        const double cells = std::hypot(dx - kDistanceRadiusCells, dy - kDistanceRadiusCells);
        const double units = std::min(std::round(cells * kDistanceUnitsPerCell), static_cast<double>(kDistanceFar));
        rows[static_cast<std::size_t>(dy)][static_cast<std::size_t>(dx)] = static_cast<std::uint8_t>(units);
      }
    }
  }
};

const StampKernel& kernel() {
  static const StampKernel kInstance;
  return kInstance;
}

// Lowers the part of the kernel around (cx, cy), in cells of this block, that falls into the block.
void stamp_into(std::uint8_t* plane, int cx, int cy) {
  const int x0 = std::max(cx - kDistanceRadiusCells, 0);
  const int x1 = std::min(cx + kDistanceRadiusCells, kBlockCells - 1);
  const int y0 = std::max(cy - kDistanceRadiusCells, 0);
  const int y1 = std::min(cy + kDistanceRadiusCells, kBlockCells - 1);
  for (int y = y0; y <= y1; ++y) {
    const std::uint8_t* from = kernel().rows[static_cast<std::size_t>(y - cy + kDistanceRadiusCells)].data() +
                               (x0 - cx + kDistanceRadiusCells);
    std::uint8_t* to = plane + y * kBlockCells + x0;
    const int n = x1 - x0 + 1;
    for (int i = 0; i < n; ++i) to[i] = std::min(to[i], from[i]);
  }
}

}  // namespace

DistanceLayers::DistanceLayers(int max_planes, int max_layers)
    : planes_(static_cast<std::size_t>(max_planes) * kBlockArea),
      references_(static_cast<std::size_t>(max_planes)),
      layers_(static_cast<std::size_t>(max_layers)) {
  std::fill_n(planes_.begin(), kBlockArea, kDistanceFar);
  free_planes_.reserve(static_cast<std::size_t>(max_planes));
  for (int i = max_planes - 1; i >= 1; --i) free_planes_.push_back(static_cast<std::uint16_t>(i));
  for (Layer& layer : layers_) layer.used_blocks.reserve(kDirectorySize);
}

int DistanceLayers::create() {
  const auto it = std::find_if(layers_.begin(), layers_.end(), [](const Layer& l) { return !l.in_use; });
  if (it == layers_.end()) return -1;
  it->in_use = true;
  return static_cast<int>(it - layers_.begin());
}

int DistanceLayers::duplicate(int layer) {
  const int copy = create();
  if (copy < 0) return -1;
  const Layer& from = layers_[static_cast<std::size_t>(layer)];
  Layer& to = layers_[static_cast<std::size_t>(copy)];
  to.directory = from.directory;
  to.used_blocks.assign(from.used_blocks.begin(), from.used_blocks.end());
  for (const std::uint16_t block : to.used_blocks) ++references_[to.directory[block]];
  return copy;
}

void DistanceLayers::release(int layer) {
  Layer& l = layers_[static_cast<std::size_t>(layer)];
  for (const std::uint16_t block : l.used_blocks) {
    release_plane(l.directory[block]);
    l.directory[block] = 0;
  }
  l.used_blocks.clear();
  l.in_use = false;
}

void DistanceLayers::release_plane(std::uint16_t plane) {
  if (--references_[plane] == 0) free_planes_.push_back(plane);
}

std::uint8_t* DistanceLayers::writable_plane(Layer& layer, int block) {
  std::uint16_t& handle = layer.directory[static_cast<std::size_t>(block)];
  if (handle != 0 && references_[handle] == 1) return planes_.data() + static_cast<std::size_t>(handle) * kBlockArea;
  if (free_planes_.empty()) return nullptr;
  const std::uint16_t fresh = free_planes_.back();
  free_planes_.pop_back();
  std::uint8_t* to = planes_.data() + static_cast<std::size_t>(fresh) * kBlockArea;
  std::memcpy(to, planes_.data() + static_cast<std::size_t>(handle) * kBlockArea, kBlockArea);
  references_[fresh] = 1;
  if (handle == 0) {
    layer.used_blocks.push_back(static_cast<std::uint16_t>(block));
  } else {
    release_plane(handle);
  }
  handle = fresh;
  peak_planes_ = std::max(peak_planes_, static_cast<int>(references_.size() - 1 - free_planes_.size()));
  return to;
}

bool DistanceLayers::stamp(int layer, CellIndex cell) {
  Layer& l = layers_[static_cast<std::size_t>(layer)];
  const int bx0 = std::max(cell.ix - kDistanceRadiusCells, 0) >> 6;
  const int bx1 = std::min(cell.ix + kDistanceRadiusCells, kMapCells - 1) >> 6;
  const int by0 = std::max(cell.iy - kDistanceRadiusCells, 0) >> 6;
  const int by1 = std::min(cell.iy + kDistanceRadiusCells, kMapCells - 1) >> 6;
  bool complete = true;
  for (int by = by0; by <= by1; ++by) {
    for (int bx = bx0; bx <= bx1; ++bx) {
      std::uint8_t* plane = writable_plane(l, by * kDirectoryBlocks + bx);
      if (plane == nullptr) {
        complete = false;
        continue;
      }
      stamp_into(plane, cell.ix - bx * kBlockCells, cell.iy - by * kBlockCells);
    }
  }
  return complete;
}

bool DistanceLayers::clear_occupied(int layer, CellIndex cell) {
  Layer& l = layers_[static_cast<std::size_t>(layer)];
  std::uint8_t* plane = writable_plane(l, block_of(cell));
  if (plane == nullptr) return false;
  std::uint8_t& value = plane[offset_of(cell)];
  if (value == 0) value = kDistanceUnitsPerCell;
  return true;
}

bool DistanceLayers::rebuild_block(int layer, int block) {
  Layer& l = layers_[static_cast<std::size_t>(layer)];
  if (l.directory[static_cast<std::size_t>(block)] == 0) return true;
  std::uint8_t* plane = writable_plane(l, block);
  if (plane == nullptr) return false;
  // Occupied cells (value 0) of this block and of the 8-cell rim around it.
  const int bx = block % kDirectoryBlocks;
  const int by = block / kDirectoryBlocks;
  std::array<std::uint8_t, kBlockArea> fresh;
  fresh.fill(kDistanceFar);
  for (int ny = std::max(by - 1, 0); ny <= std::min(by + 1, kDirectoryBlocks - 1); ++ny) {
    for (int nx = std::max(bx - 1, 0); nx <= std::min(bx + 1, kDirectoryBlocks - 1); ++nx) {
      const std::uint16_t handle = l.directory[static_cast<std::size_t>(ny * kDirectoryBlocks + nx)];
      if (handle == 0) continue;
      const std::uint8_t* from = planes_.data() + static_cast<std::size_t>(handle) * kBlockArea;
      const int ox = (nx - bx) * kBlockCells;
      const int oy = (ny - by) * kBlockCells;
      const int y0 = std::max(0, -kDistanceRadiusCells - oy);
      const int y1 = std::min(kBlockCells - 1, kBlockCells - 1 + kDistanceRadiusCells - oy);
      const int x0 = std::max(0, -kDistanceRadiusCells - ox);
      const int x1 = std::min(kBlockCells - 1, kBlockCells - 1 + kDistanceRadiusCells - ox);
      for (int y = y0; y <= y1; ++y) {
        for (int x = x0; x <= x1; ++x) {
          if (from[y * kBlockCells + x] == 0) stamp_into(fresh.data(), x + ox, y + oy);
        }
      }
    }
  }
  std::memcpy(plane, fresh.data(), kBlockArea);
  return true;
}

DistanceView DistanceLayers::view(int layer) const {
  return {layers_[static_cast<std::size_t>(layer)].directory.data(), planes_.data()};
}

std::size_t DistanceLayers::bytes_used() const {
  return (references_.size() - 1 - free_planes_.size()) * kBlockArea;
}

}  // namespace submapd
