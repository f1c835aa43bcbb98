#include "slam/output/internal/map_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "slam/submap/finished_submap.hpp"

namespace submapd::internal {
namespace {

constexpr int kWantedSide_px = 1200;
constexpr int kMaxWidth_px = 2400;
constexpr int kMaxHeight_px = 2000;  // leaves 400 for title and legend
constexpr int kMinWidth_px = 720;    // for title and legend
constexpr int kMaxEnlargement = 8;
constexpr double kMargin = 0.04;  // of the long side, or of three times the short one if that is less
constexpr int kMinMargin_cells = 6;

// Cells [left, right) x [bottom, top).
struct CellBox {
  int left;
  int bottom;
  int right;
  int top;

  void add(int x, int y) {
    left = std::min(left, x);
    bottom = std::min(bottom, y);
    right = std::max(right, x + 1);
    top = std::max(top, y + 1);
  }
};

CellBox shown_cells(const MapImage& map, std::span<const Pose2> path) {
  CellBox box{map.width, map.height, 0, 0};
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      if (map.at(x, y) != 0) box.add(x, y);
    }
  }
  for (const Pose2& pose : path) {
    const double x = std::floor((pose.x - map.origin_x_m) / map.cell_m);
    const double y = std::floor((pose.y - map.origin_y_m) / map.cell_m);
    if (x >= 0.0 && y >= 0.0 && x < map.width && y < map.height) box.add(static_cast<int>(x), static_cast<int>(y));
  }
  return box.left < box.right ? box : CellBox{0, 0, map.width, map.height};
}

// How dark a cell's byte is drawn: full from the occupied threshold of map.pgm on, not at all from its mirror image
// down.
std::array<double, 256> ink_table() {
  std::array<double, 256> ink{};
  for (std::size_t cell = 1; cell < ink.size(); ++cell) {
    ink[cell] = std::clamp((occupancy_of(static_cast<std::uint8_t>(cell)) - 0.35) / 0.30, 0.0, 1.0);
  }
  return ink;
}

// The cells a pixel covers along one axis, [first, last]; neighbours share a cell only where its border is inside a
// pixel.
struct Span {
  int first;
  int last;
};
Span covered(int pixel, double px_per_cell, int start_cell) {
  const double low = pixel / px_per_cell;
  const double high = (pixel + 1) / px_per_cell;
  const int first = static_cast<int>(std::floor(low + 1e-9));
  return {start_cell + first, start_cell + std::max(first, static_cast<int>(std::ceil(high - 1e-9)) - 1)};
}

}  // namespace

Eigen::Vector2d MapView::to_pixel(const Eigen::Vector2d& point_m) const {
  const double x_cell = (point_m.x() - origin_x_m) / cell_m - left_cell;
  const double y_cell = (point_m.y() - origin_y_m) / cell_m - bottom_cell;
  return {x_cell * px_per_cell, top + height - y_cell * px_per_cell};
}

Eigen::Vector2d MapView::lower_left_m() const {
  return {origin_x_m + left_cell * cell_m, origin_y_m + bottom_cell * cell_m};
}

MapView fit_view(const MapImage& map, std::span<const Pose2> path) {
  const CellBox box = shown_cells(map, path);
  const int known_width = box.right - box.left;
  const int known_height = box.top - box.bottom;
  const int base = std::min(std::max(known_width, known_height), 3 * std::min(known_width, known_height));
  const int margin = std::max(kMinMargin_cells, static_cast<int>(kMargin * base));
  const int width_cells = known_width + 2 * margin;
  const int height_cells = known_height + 2 * margin;

  MapView view;
  view.cell_m = map.cell_m;
  view.origin_x_m = map.origin_x_m;
  view.origin_y_m = map.origin_y_m;
  const double largest =
      std::min(static_cast<double>(kMaxWidth_px) / width_cells, static_cast<double>(kMaxHeight_px) / height_cells);
  view.px_per_cell = largest;
  if (largest >= 1.0) {
    const double wanted = std::ceil(static_cast<double>(kWantedSide_px) / std::max(width_cells, height_cells));
    view.px_per_cell = std::min({wanted, std::floor(largest), static_cast<double>(kMaxEnlargement)});
  }
  view.height = std::max(1, static_cast<int>(std::floor(height_cells * view.px_per_cell + 1e-9)));
  view.width = std::max(1, static_cast<int>(std::floor(width_cells * view.px_per_cell + 1e-9)));
  view.bottom_cell = box.bottom - margin;
  view.left_cell = box.left - margin;
  if (view.width < kMinWidth_px) {
    view.left_cell -= static_cast<int>((kMinWidth_px - view.width) / (2.0 * view.px_per_cell));
    view.width = kMinWidth_px;
  }
  return view;
}

void paint_map(Canvas& canvas, const MapView& view, const MapImage& map) {
  const std::array<double, 256> ink = ink_table();
  std::array<Color, 256> color_of;  // of a pixel within one cell, as most are in small maps
  for (std::size_t cell = 0; cell < color_of.size(); ++cell) {
    color_of[cell] = mix(cell != 0 ? kFreeColor : kUnknownColor, kWallColor, ink[cell]);
  }
  std::vector<Span> columns;
  for (int column = 0; column < view.width; ++column) {
    columns.push_back(covered(column, view.px_per_cell, view.left_cell));
  }
  for (int row = 0; row < view.height; ++row) {
    const Span ys = covered(view.height - 1 - row, view.px_per_cell, view.bottom_cell);
    for (int column = 0; column < view.width; ++column) {
      const Span xs = columns[static_cast<std::size_t>(column)];
      const int cells = (ys.last - ys.first + 1) * (xs.last - xs.first + 1);
      int known = 0;
      double darkest = 0.0;
      std::uint8_t last = 0;
      for (int y = std::max(ys.first, 0); y <= std::min(ys.last, map.height - 1); ++y) {
        for (int x = std::max(xs.first, 0); x <= std::min(xs.last, map.width - 1); ++x) {
          last = map.at(x, y);
          known += last != 0 ? 1 : 0;
          darkest = std::max(darkest, ink[last]);
        }
      }
      const auto mixed = [&] {
        return mix(mix(kUnknownColor, kFreeColor, static_cast<double>(known) / cells), kWallColor, darkest);
      };
      canvas.set(column, view.top + row, cells == 1 ? color_of[last] : mixed());
    }
  }
}

}  // namespace submapd::internal
