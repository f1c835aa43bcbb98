// Sub-cell surface statistics on 10 cm cells: what stage 2 of the matcher aligns to (design notes 4.2 G, 5.2).
//
// A face holds the hits of one cell that belong to one wall, as count, sum and scatter about the cell's centre: those
// whose normals, as the single scans saw them, lie within 45 deg (a jamb and the wall beside it are two faces, and so
// are the sides of a thin wall); hits without a normal go by the side they are seen from. To that comes the *pooled*
// line through the same face of the 3 x 3 cells around: pooling keeps a wall on a cell border from being split and
// biased. Where those nine hold no straight wall (a door that stands back by centimetres), their line is none that a
// beam hits, and its slant pushes the cart by millimetres a metre; the cell's own hits make the line there. Cells next
// to a hit have a face without hits of their own, so that a point beside the wall finds its line in O(1). Fixed pools;
// when they are full new cells are refused and counted. Reading is thread-safe while nobody inserts.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slam/base/floor_to_int.hpp"
#include "slam/grid/grid_geometry.hpp"

namespace submapd {

inline constexpr double kSurfaceCell_m = 0.10;
inline constexpr int kSurfacePerBlockSide = 32;  // 3.2 m blocks as in the index map
inline constexpr int kSurfacePerBlock = kSurfacePerBlockSide * kSurfacePerBlockSide;
inline constexpr int kSurfaceSide = kDirectoryBlocks * kSurfacePerBlockSide;  // cells along one side of the map
inline constexpr int kSurfaceBias = kSurfaceSide / 2;
// Share of the trace of an information matrix that noisy normals fake in a direction without any (notes 5.4).
inline constexpr double kNormalNoiseShare = 0.005;

enum class SurfaceKind : std::uint8_t { kNone, kPoint, kLine };

struct PooledLine {
  float mean_x = 0.0F;  // m, sub-map frame
  float mean_y = 0.0F;
  float normal_x = 0.0F;  // unit, towards the viewers; (0, 0) unless kLine
  float normal_y = 0.0F;
  float sigma_m = 0.0F;        // spread across the line (kLine; at least as scans err) or of the hits (kPoint)
  float half_length_m = 0.0F;  // one sigma along the line
  float count = 0.0F;          // hits pooled
  std::uint16_t scans = 0;     // of the pooled cell that most scans hit: what stands still gathers them
  SurfaceKind kind = SurfaceKind::kNone;
  bool moved = false;  // most of its hits lie where the map had been seen free: it came there
};

// How a face is seen: what tells the faces of one cell apart.
struct SurfaceLook {
  float view_x = 0.0F;  // unit, towards the sensor
  float view_y = 0.0F;
  float normal_x = 0.0F;  // unit, towards the sensor; (0, 0) if unknown
  float normal_y = 0.0F;
};

struct alignas(64) SurfaceFace {
  float view_x = 0.0F;  // mean direction towards the sensor, not normalised
  float view_y = 0.0F;
  float normal_x = 0.0F;  // mean normal, not normalised; (0, 0) while no scan told it
  float normal_y = 0.0F;
  // Statistics of this cell's own hits, about the cell's centre.
  float n = 0.0F;
  float sum_x = 0.0F;
  float sum_y = 0.0F;
  float sum_xx = 0.0F;
  float sum_xy = 0.0F;
  float sum_yy = 0.0F;
  float in_free = 0.0F;            // hits where the map had been seen free
  float pending = 0.0F;            // hits in the 3 x 3 cells since the lines were computed
  std::uint32_t cell = 0;          // iy * kSurfaceSide + ix
  std::uint16_t other = 0;         // the cell's next face; 0: none
  std::uint16_t keyframes = 0;     // scans that hit it; saturates
  std::uint16_t touched_scan = 0;  // marks faces hit by the scan being inserted
  std::uint8_t view_sectors = 0;
  alignas(64) PooledLine pooled;  // of the 3 x 3 cells
  PooledLine own;                 // of this cell alone; kNone where `pooled` says as much or there are few hits

  [[nodiscard]] const PooledLine& line() const { return own.kind == SurfaceKind::kNone ? pooled : own; }
};

struct SurfaceHit {
  float x = 0.0F;  // m, sub-map frame
  float y = 0.0F;
  SurfaceLook look;
  bool in_free = false;  // where the map has been seen free: of something that moves
};

// Index of the surface cell at a coordinate [m] of the sub-map's frame.
[[nodiscard]] inline int surface_index(float position_m) {
  return floor_to_int(position_m * static_cast<float>(1.0 / kSurfaceCell_m)) + kSurfaceBias;
}
// Cells of the rim have no neighbours and hold nothing.
[[nodiscard]] inline bool in_surface(int ix, int iy) {
  return ix >= 1 && iy >= 1 && ix < kSurfaceSide - 1 && iy < kSurfaceSide - 1;
}

class SurfaceMap {
 public:
  SurfaceMap(int max_faces, int max_blocks);
  void clear();

  // Adds one scan's hits and refreshes the pooled lines that changed by more than a tenth.
  void insert(std::span<const SurfaceHit> hits);
  // Forgets the hits in the surface cell at (x, y): its fine cells have been seen free.
  void forget(double x_m, double y_m);

  // Line near (x, y) of what looks so; nullptr if there is none.
  [[nodiscard]] const PooledLine* find(float x_m, float y_m, const SurfaceLook& look) const {
    const SurfaceFace* face = face_at(x_m, y_m, look);
    return face != nullptr && face->line().kind != SurfaceKind::kNone ? &face->line() : nullptr;
  }
  // What find() goes by besides the look; -1 outside.
  [[nodiscard]] static int cell_of(float x_m, float y_m) {
    const int ix = surface_index(x_m);
    const int iy = surface_index(y_m);
    return in_surface(ix, iy) ? iy * kSurfaceSide + ix : -1;
  }
  // The same of the 3 x 3 cells, whatever they hold.
  [[nodiscard]] const PooledLine* find_pooled(float x_m, float y_m, const SurfaceLook& look) const {
    const SurfaceFace* face = face_at(x_m, y_m, look);
    return face != nullptr && face->pooled.kind != SurfaceKind::kNone ? &face->pooled : nullptr;
  }

  // Faces in use, in order of creation (index 0 is not one).
  [[nodiscard]] std::span<const SurfaceFace> faces() const { return {faces_.data(), used_faces_}; }
  // Inserted since clear().
  [[nodiscard]] int scans() const { return scan_; }
  [[nodiscard]] std::size_t bytes_used() const;
  [[nodiscard]] std::size_t bytes_limit() const;
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  struct Block {
    std::array<std::uint16_t, kSurfacePerBlock> slot{};
  };
  // Face of the cell that looks so, made if there is room; 0 if not.
  std::uint16_t ensure_face(int ix, int iy, const SurfaceLook& look);
  [[nodiscard]] std::uint16_t find_face(int ix, int iy, const SurfaceLook& look) const;
  // nullptr if there is none.
  [[nodiscard]] const SurfaceFace* face_at(float x_m, float y_m, const SurfaceLook& look) const;
  // Of all faces of the cell.
  [[nodiscard]] float hits_of_side(int ix, int iy, const SurfaceLook& look) const;
  void refresh(SurfaceFace& face);

  std::vector<SurfaceFace> faces_;
  std::size_t used_faces_ = 1;
  std::array<std::uint16_t, kDirectorySize> directory_{};
  std::vector<Block> blocks_;  // block 0 is the shared empty one
  std::size_t used_blocks_ = 1;
  std::vector<std::uint16_t> touched_;
  std::uint16_t scan_ = 0;
  std::uint64_t refused_ = 0;
};

// Centre of a surface cell [m].
[[nodiscard]] inline float surface_centre(int index) {
  return (static_cast<float>(index - kSurfaceBias) + 0.5F) * static_cast<float>(kSurfaceCell_m);
}

}  // namespace submapd
