// The dynamic index map of one active sub-map: count-based occupancy on blocks made on demand (paper 2.2, equations
// (6)-(8)).
//
// Look-up is two steps, directory then block, both O(1). Evidence is kept as counts c_o (hits) and c_f (looked
// through), at most one of them a cell and scan; equation (7) with its misprint corrected gives log L = c_f log O_f +
// c_o log O_o and equation (8) p = L / (1 + L), evaluated as a logistic function. Cells beyond a hit get nothing, so
// occupied, free and unknown stay apart. The map keeps its layer of the distance field and its surface statistics in
// step with the counts. Memory is taken once, at construction. One writer thread; readers only while nobody writes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/grid/distance_layers.hpp"
#include "slam/grid/free_space.hpp"
#include "slam/grid/grid_geometry.hpp"
#include "slam/grid/surface_map.hpp"

namespace submapd {

struct OccupancyOptions {
  double odds_hit = 2.33;        // O_o > 1: p = 0.70 after one hit
  double odds_free = 0.67;       // O_f < 1: p = 0.40 after one look through
  double occupied_above = 0.65;  // a cell becomes an obstacle above this p ...
  double free_below = 0.35;      // ... and stops being one below this
};

struct IndexMapOptions {
  double cell_m = 0.05;
  int max_blocks = 400;   // of 64 x 64 cells
  int max_faces = 30000;  // surface statistics
  int max_beams = 2048;
  OccupancyOptions occupancy;
  FreeSpaceOptions free_space;
};

// p of equation (8) for counts; finite for any counts.
[[nodiscard]] double occupancy_probability(std::uint64_t hits, std::uint64_t misses, const OccupancyOptions& options);

class IndexMap {
 public:
  // Takes one layer of `layers`, which must outlive the map. REQUIRES: a layer is free.
  IndexMap(const IndexMapOptions& options, DistanceLayers& layers);
  ~IndexMap();
  IndexMap(const IndexMap&) = delete;
  IndexMap& operator=(const IndexMap&) = delete;

  // Forgets everything, for the next sub-map.
  void clear();

  // Adds one scan. `origin` is the sensor, `beams` its ends in order of angle, all in the map's frame [m].
  // Returns false if a pool was full and part of the scan was not stored (also counted).
  bool insert(const Eigen::Vector2f& origin, std::span<const BeamEnd> beams);

  [[nodiscard]] DistanceView distance() const { return layers_.view(layer_); }
  [[nodiscard]] int layer() const { return layer_; }
  [[nodiscard]] const SurfaceMap& surface() const { return surface_; }
  [[nodiscard]] double cell_m() const { return options_.cell_m; }

  struct Counts {
    std::uint8_t hits = 0;
    std::uint8_t misses = 0;
  };
  [[nodiscard]] Counts counts(CellIndex cell) const;
  // True if the cell has evidence of either kind.
  [[nodiscard]] bool known(CellIndex cell) const {
    const Counts c = counts(cell);
    return c.hits != 0 || c.misses != 0;
  }

  [[nodiscard]] int blocks_used() const { return static_cast<int>(used_blocks_) - 1; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }
  [[nodiscard]] std::size_t bytes_used() const;
  [[nodiscard]] std::size_t bytes_limit() const;

  // Copies of every block, sorted by (by, bx), as probabilities. Allocates: not for the real-time path.
  [[nodiscard]] std::vector<OccupancyBlock> export_blocks() const;
  // Surface points with hits of their own, in order of creation. Allocates.
  [[nodiscard]] std::vector<SurfacePoint> export_surface() const;

 private:
  struct Block {
    alignas(64) std::array<std::uint8_t, kBlockArea> hits{};
    alignas(64) std::array<std::uint8_t, kBlockArea> misses{};
    alignas(64) std::array<std::uint8_t, kBlockArea> marks{};  // scan that last hit the cell
    std::int32_t index = 0;                                    // in the directory
  };

  Block* ensure_block(int block);
  // Returns whether the cell was seen free more often than hit.
  bool add_hit(CellIndex cell);
  void add_free_span(const RowSpan& span);
  void review_cell(Block& block, int offset);
  void rebuild_dirty();

  IndexMapOptions options_;
  DistanceLayers& layers_;
  int layer_;
  double cells_per_m_;
  SurfaceMap surface_;
  FreeSpacePolygon free_space_;
  std::array<std::uint16_t, kDirectorySize> directory_{};
  std::vector<Block> blocks_;  // block 0 is the shared all-unknown one
  std::size_t used_blocks_ = 1;
  std::vector<SurfaceHit> hits_;
  std::vector<int> dirty_;  // blocks whose distances must be rebuilt; bounded
  std::array<bool, kDirectorySize> is_dirty_{};
  std::uint8_t scan_mark_ = 0;
  double occupied_log_odds_;
  double free_log_odds_;
  std::array<float, 256> hit_log_odds_{};
  std::array<float, 256> miss_log_odds_{};
  std::uint64_t refused_ = 0;
};

}  // namespace submapd
