#include "slam/output/internal/canvas.hpp"

#include <algorithm>
#include <cmath>

#include "slam/output/internal/font.hpp"

namespace submapd::internal {
namespace {

std::uint8_t mix(std::uint8_t a, std::uint8_t b, double s) {
  return static_cast<std::uint8_t>(static_cast<double>(a) + s * (static_cast<double>(b) - static_cast<double>(a)) +
                                   0.5);
}

int to_index(double value, int limit) {
  return static_cast<int>(std::clamp(std::floor(value), 0.0, static_cast<double>(limit)));
}

// Cuts the segment to low <= coordinate <= high along one axis; false: nothing is left.
bool clip(Eigen::Vector2d& from, Eigen::Vector2d& to, int axis, double low, double high) {
  const double start = from[axis];
  const double length = to[axis] - start;
  if (length == 0.0) return start >= low && start <= high;
  double first = (low - start) / length;
  double last = (high - start) / length;
  if (first > last) std::swap(first, last);
  first = std::max(first, 0.0);
  last = std::min(last, 1.0);
  if (first > last) return false;
  const Eigen::Vector2d step = to - from;
  to = from + last * step;
  from += first * step;
  return true;
}

}  // namespace

Color mix(Color a, Color b, double s) {
  return {mix(a.r, b.r, s), mix(a.g, b.g, s), mix(a.b, b.b, s)};
}

Canvas::Canvas(int width, int height, Color background)
    : width_(width), height_(height), pixels_(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
  rectangle(0, 0, width, height, background);
}

Color Canvas::at(int x, int y) const {
  const std::span<const std::uint8_t> pixel = row(y).subspan(3 * static_cast<std::size_t>(x), 3);
  return {pixel[0], pixel[1], pixel[2]};
}

void Canvas::set(int x, int y, Color color) {
  const std::size_t index =
      3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x));
  pixels_[index] = color.r;
  pixels_[index + 1] = color.g;
  pixels_[index + 2] = color.b;
}

std::span<const std::uint8_t> Canvas::row(int y) const {
  const std::size_t bytes = 3 * static_cast<std::size_t>(width_);
  return std::span(pixels_).subspan(static_cast<std::size_t>(y) * bytes, bytes);
}

void Canvas::rectangle(int left, int top, int right, int bottom, Color color) {
  for (int y = std::max(top, 0); y < std::min(bottom, height_); ++y) {
    for (int x = std::max(left, 0); x < std::min(right, width_); ++x) set(x, y, color);
  }
}

void Canvas::line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width_px, Color color) {
  if (!from.allFinite() || !to.allFinite()) return;
  const double reach = width_px / 2.0 + 0.5;  // coverage falls from 1 to 0 over one pixel
  Eigen::Vector2d a = from;
  Eigen::Vector2d b = to;
  if (!clip(a, b, 0, -reach, width_ + reach) || !clip(a, b, 1, -reach, height_ + reach)) return;
  const Eigen::Vector2d step = b - a;
  const double length2 = step.squaredNorm();
  const int bottom = to_index(std::max(a.y(), b.y()) + reach, height_ - 1);
  for (int y = to_index(std::min(a.y(), b.y()) - reach, height_ - 1); y <= bottom; ++y) {
    // Only the piece of the line within reach of this row is looked at.
    Eigen::Vector2d near_a = a;
    Eigen::Vector2d near_b = b;
    if (!clip(near_a, near_b, 1, y + 0.5 - reach, y + 0.5 + reach)) continue;
    const int right = to_index(std::max(near_a.x(), near_b.x()) + reach, width_ - 1);
    for (int x = to_index(std::min(near_a.x(), near_b.x()) - reach, width_ - 1); x <= right; ++x) {
      const Eigen::Vector2d center(x + 0.5, y + 0.5);
      const double along = length2 > 0.0 ? std::clamp((center - a).dot(step) / length2, 0.0, 1.0) : 0.0;
      const double coverage = reach - (center - a - along * step).norm();
      if (coverage > 0.0) blend(x, y, color, std::min({coverage, width_px, 1.0}));
    }
  }
}

void Canvas::dashed_line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, double width_px, double dash_px,
                         Color color) {
  Eigen::Vector2d a = from;
  Eigen::Vector2d b = to;
  if (!a.allFinite() || !b.allFinite() || !clip(a, b, 0, -dash_px, width_ + dash_px) ||
      !clip(a, b, 1, -dash_px, height_ + dash_px)) {
    return;
  }
  const double length = (b - a).norm();
  const Eigen::Vector2d direction = length > 0.0 ? Eigen::Vector2d((b - a) / length) : Eigen::Vector2d::Zero();
  for (double start = 0.0; start <= length; start += 1.8 * dash_px) {
    line(a + start * direction, a + std::min(start + dash_px, length) * direction, width_px, color);
  }
}

void Canvas::text(const Eigen::Vector2d& top_left, std::string_view text, double dot_px, double stroke_px,
                  Color color) {
  double left = top_left.x();
  for (const char character : text) {
    const Glyph glyph = glyph_of(character);
    const auto center = [&](int column, int row) {
      return Eigen::Vector2d(left + (column - glyph.first_column + 0.5) * dot_px, top_left.y() + (row + 0.5) * dot_px);
    };
    for (int row = 0; row < kGlyphRows; ++row) {
      for (int column = 0; column < kGlyphColumns; ++column) {
        if (!glyph.dot(column, row)) continue;
        // Dots that touch become strokes, diagonal ones only where no corner lies between them.
        const bool right = glyph.dot(column + 1, row);
        const bool below = glyph.dot(column, row + 1);
        const bool below_left = !below && !glyph.dot(column - 1, row) && glyph.dot(column - 1, row + 1);
        const bool below_right = !below && !right && glyph.dot(column + 1, row + 1);
        if (right) line(center(column, row), center(column + 1, row), stroke_px, color);
        if (below) line(center(column, row), center(column, row + 1), stroke_px, color);
        if (below_left) line(center(column, row), center(column - 1, row + 1), stroke_px, color);
        if (below_right) line(center(column, row), center(column + 1, row + 1), stroke_px, color);
        if (!right && !below) disc(center(column, row), stroke_px / 2.0, color);
      }
    }
    left += (glyph.columns + kLetterGap) * dot_px;
  }
}

void Canvas::blend(int x, int y, Color color, double coverage) {
  set(x, y, internal::mix(at(x, y), color, coverage));
}

}  // namespace submapd::internal
