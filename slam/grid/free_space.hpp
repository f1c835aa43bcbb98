// The region a scan has looked through, as a visibility polygon converted to row spans (design notes 4.4).
//
// Star-shaped polygon: the sensor and, beam by beam, the end of what was seen free. Each cell is visited once a scan,
// which a ray per beam does not give, and the spans can be added with vector instructions. No allocation after
// construction.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/grid/grid_geometry.hpp"

namespace submapd {

// Cells [ix_begin, ix_end) of row iy.
struct RowSpan {
  int iy = 0;
  int ix_begin = 0;
  int ix_end = 0;
};

// End of one beam, in order of angle.
struct BeamEnd {
  float x = 0.0F;         // m, map frame, of the measured point (any value when range_m is 0)
  float y = 0.0F;         // m
  float range_m = 0.0F;   // distance from the sensor; 0: no evidence along this beam
  bool hit = true;        // false: free along range_m but nothing was hit at its end
  float normal_x = 0.0F;  // unit, of the surface hit, towards the sensor; (0, 0) if unknown
  float normal_y = 0.0F;
};

// Beams and their origin moved by `pose`; returns the moved origin. Keeps what fits into placed's capacity: no
// allocation.
Eigen::Vector2f place_beams(const Pose2& pose, std::span<const BeamEnd> beams, const Eigen::Vector2f& origin,
                            std::vector<BeamEnd>& placed);

struct FreeSpaceOptions {
  double max_range_m = 15.0;     // carve no farther
  double pull_back_cells = 1.5;  // keep this far from the hit
  double edge_jump_m = 0.3;      // neighbours farther apart than this: both take the shorter range
};

class FreeSpacePolygon {
 public:
  // max_beams bounds the memory; further beams are ignored.
  FreeSpacePolygon(const FreeSpaceOptions& options, double cell_m, int max_beams);

  // Spans of the cells whose centres lie in the region seen free from (origin_x, origin_y) [m], rows ascending, no cell
  // twice, clipped to the map. Valid until the next call.
  std::span<const RowSpan> convert(float origin_x, float origin_y, std::span<const BeamEnd> beams);

 private:
  struct Vertex {
    float u;  // cells, map index space
    float v;
  };
  void add_vertex(float u, float v);
  void collect_crossings();

  FreeSpaceOptions options_;
  float cells_per_m_;
  std::size_t max_beams_;
  std::vector<Vertex> vertices_;
  std::vector<std::uint32_t> row_start_;  // prefix sums of crossings per row
  std::vector<float> crossings_;
  std::vector<RowSpan> spans_;
  int first_row_ = 0;
  int last_row_ = -1;
};

}  // namespace submapd
