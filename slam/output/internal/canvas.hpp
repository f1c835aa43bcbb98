// An RGB picture in memory with the few anti-aliased shapes map.png is made of.
//
// Pixels: x right, y down, pixel (i, j) covers [i, i + 1) x [j, j + 1). Shapes may lie anywhere: what falls outside is
// clipped at no cost, what is not finite is not drawn. One thread.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

namespace submapd::internal {

struct Color {
  std::uint8_t r = 0;
  std::uint8_t g = 0;
  std::uint8_t b = 0;
  friend bool operator==(const Color&, const Color&) = default;
};

// The colour a share s in [0, 1] of the way from a to b.
[[nodiscard]] Color mix(Color a, Color b, double s);

class Canvas {
 public:
  // REQUIRES: width > 0, height > 0.
  Canvas(int width, int height, Color background);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  // REQUIRES for these three: the pixel, or row, exists.
  [[nodiscard]] Color at(int x, int y) const;
  void set(int x, int y, Color color);
  [[nodiscard]] std::span<const std::uint8_t> row(int y) const;  // R G B R G B ...

  // Pixels [left, right) x [top, bottom).
  void rectangle(int left, int top, int right, int bottom, Color color);
  // Straight line with round ends.
  void line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width_px, Color color);
  void dashed_line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width_px, double dash_px,
                   Color color);
  void disc(const Eigen::Vector2d& center, double radius_px, Color color) {
    line(center, center, 2.0 * radius_px, color);
  }

  // One line of text; `top_left` is the corner of its first capital, `dot_px` the pitch of the font's dots and
  // `stroke_px` the width of its strokes.
  void text(const Eigen::Vector2d& top_left, std::string_view text, double dot_px, double stroke_px, Color color);

 private:
  void blend(int x, int y, Color color, double coverage);

  int width_;
  int height_;
  std::vector<std::uint8_t> pixels_;
};

}  // namespace submapd::internal
