// The direction of the surface about each point of a scan, from the points beside it.
//
// At a corner a window about the point holds two walls and says neither's direction. Of three windows, before, about
// and behind the point, the one whose points lie closest to a line counts, so a corner stays sharp to a beam or two.
#pragma once

#include <array>
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
  struct Sums {
    double x = 0.0;
    double y = 0.0;
    double xx = 0.0;
    double xy = 0.0;
    double yy = 0.0;
  };
  struct Line {
    float small_m2 = 0.0F;  // mean square off the line, for the window's count
    float normal_x = 0.0F;
    float normal_y = 0.0F;
    bool known = false;
  };
  [[nodiscard]] Line line_through(std::size_t first, std::size_t last) const;

  std::vector<Sums> before_;  // of all points before this one
};

}  // namespace submapd
