// Which piece of a map a picture shows, at what scale, and where on the canvas; and the painting of the map itself.
#pragma once

#include <Eigen/Core>
#include <span>

#include "slam/base/pose2.hpp"
#include "slam/output/internal/canvas.hpp"
#include "slam/output/map_image.hpp"

namespace submapd::internal {

inline constexpr Color kFreeColor{255, 255, 255};
inline constexpr Color kWallColor{22, 24, 30};
inline constexpr Color kUnknownColor{208, 212, 218};

// Panel of `width` x `height` pixels showing cells from (left_cell, bottom_cell) on; they may lie outside the map.
struct MapView {
  int left_cell = 0;
  int bottom_cell = 0;
  double px_per_cell = 1.0;  // a whole number, or below 1
  int width = 0;             // px
  int height = 0;            // px
  int top = 0;               // row of the panel's first line on the canvas; its first column is 0
  double cell_m = 0.05;
  double origin_x_m = 0.0;  // of cell (0, 0)
  double origin_y_m = 0.0;

  [[nodiscard]] double px_per_m() const { return px_per_cell / cell_m; }
  // Canvas position of a point in the map frame.
  [[nodiscard]] Eigen::Vector2d to_pixel(const Eigen::Vector2d& point_m) const;
  // Map frame position of the panel's lower-left corner.
  [[nodiscard]] Eigen::Vector2d lower_left_m() const;
};

// Fits the known cells and the path, as far as it lies on the map, with a margin. Small maps grow by a whole factor
// until the long side has 1200 pixels, big ones shrink to fit; the panel is at least wide enough for the text around
// it. REQUIRES: check_map_image(map).ok().
[[nodiscard]] MapView fit_view(const MapImage& map, std::span<const Pose2> path);

// Free white, walls dark, unknown grey. Where a pixel covers several cells it is as dark as the most occupied one, so
// that thin walls stay, and as grey as the share of unknown ones.
void paint_map(Canvas& canvas, const MapView& view, const MapImage& map);

}  // namespace submapd::internal
