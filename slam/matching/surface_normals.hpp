// The direction of the surface about each point of a scan, from the points beside it.
//
// A window about a point beside a corner holds two walls and says neither's direction. Of three windows, before, about
// and behind the point, the one whose points lie closest to a line counts (as in Kuwahara's filter), so that a corner
// stays sharp to a beam or two. This is what tells the faces of a surface map apart: a jamb of 6 cm and the wall beside
// it share a cell of 10 cm.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slam/matching/scan_point.hpp"

namespace submapd {

class SurfaceNormals {
 public:
  explicit SurfaceNormals(std::size_t max_points);

  // Fills normal_x and normal_y of points in order of angle: unit, towards the sensor; (0, 0) where the points around
  // make no line. Does not allocate. REQUIRES: at most max_points.
  void fill(std::span<ScanPoint> points);

 private:
  // Over all points before one.
  struct Sums {
    double x = 0.0;
    double y = 0.0;
    double xx = 0.0;
    double xy = 0.0;
    double yy = 0.0;
  };
  struct Scatter;
  [[nodiscard]] Scatter scatter_of(std::size_t first, std::size_t last) const;

  void find_runs(std::span<const ScanPoint> points);

  std::vector<Sums> before_;
  std::vector<std::uint32_t> begin_;  // of the run of points without a gap that a point belongs to
  std::vector<std::uint32_t> end_;
};

}  // namespace submapd
