// Truncated distance fields of the base map and of every particle, sharing blocks copy-on-write.
//
// One plane = one block of 64 x 64 bytes: distance to the closest occupied cell in 1/8 cell, saturating at 8 cells. A
// layer is a directory of planes; duplicating a layer shares all its planes, writing to a shared one copies 4 kB
// (design notes 4.2, 4.3, 4.5; IRIS LaMa's idea, thinner). Everything lives in pools of fixed size: when they are full,
// stamp() and duplicate() say so and the caller coalesces its particles. No allocation after construction.
//
// Thread rule: stamp() on different layers from different threads is not allowed (the pool is shared); reads are.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slam/grid/grid_geometry.hpp"

namespace submapd {

inline constexpr int kDistanceRadiusCells = 8;
inline constexpr int kDistanceUnitsPerCell = 8;
inline constexpr std::uint8_t kDistanceFar = kDistanceRadiusCells * kDistanceUnitsPerCell;  // 64: "this far or farther"

// Read access to one layer; valid until the layer is written or released.
class DistanceView {
 public:
  DistanceView(const std::uint16_t* directory, const std::uint8_t* planes) : directory_(directory), planes_(planes) {}

  // Stored distance at a cell, kDistanceFar outside the map.
  [[nodiscard]] std::uint8_t at(CellIndex c) const {
    if (!in_map(c)) return kDistanceFar;
    return plane(block_of(c))[offset_of(c)];
  }
  [[nodiscard]] const std::uint8_t* plane(int block) const {
    return planes_ + static_cast<std::size_t>(directory_[block]) * kBlockArea;
  }

 private:
  const std::uint16_t* directory_;
  const std::uint8_t* planes_;
};

class DistanceLayers {
 public:
  // REQUIRES: 2 <= max_planes <= 65535, 1 <= max_layers.
  DistanceLayers(int max_planes, int max_layers);

  // A layer without any occupied cell; -1 when all layers are in use.
  [[nodiscard]] int create();
  // A layer with the same content, sharing every plane; -1 when all layers are in use.
  [[nodiscard]] int duplicate(int layer);
  void release(int layer);

  // Marks a cell as occupied: lowers the field within 8 cells of it. Returns false when the plane pool was full
  // somewhere in that area; the field then is too high there but still valid. REQUIRES: in_map(cell).
  bool stamp(int layer, CellIndex cell);

  // Rebuilds one block of a layer from its occupied cells (value 0) and those of the neighbour blocks, after cells were
  // cleared with clear_occupied(). Returns false when the block is shared and the plane pool full: nothing has changed.
  bool rebuild_block(int layer, int block);
  // Takes away the "occupied" mark of a cell; the field around it stays too low until the blocks nearby are rebuilt.
  // Returns false as rebuild_block() does.
  bool clear_occupied(int layer, CellIndex cell);

  [[nodiscard]] DistanceView view(int layer) const;
  [[nodiscard]] std::size_t bytes_used() const;
  [[nodiscard]] std::size_t bytes_peak() const { return static_cast<std::size_t>(peak_planes_) * kBlockArea; }
  [[nodiscard]] std::size_t bytes_limit() const { return planes_.size(); }
  [[nodiscard]] int free_planes() const { return static_cast<int>(free_planes_.size()); }

 private:
  struct Layer {
    bool in_use = false;
    std::array<std::uint16_t, kDirectorySize> directory{};
    std::vector<std::uint16_t> used_blocks;  // directory entries that are not 0; capacity reserved
  };

  // Plane of the block that only this layer sees; nullptr when the pool is full.
  std::uint8_t* writable_plane(Layer& layer, int block);
  void release_plane(std::uint16_t plane);

  std::vector<std::uint8_t> planes_;       // plane 0 is the shared "nothing near" plane
  std::vector<std::uint16_t> references_;  // layers that hold a plane
  std::vector<std::uint16_t> free_planes_;
  std::vector<Layer> layers_;
  int peak_planes_ = 0;
};

}  // namespace submapd
