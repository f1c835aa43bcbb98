#include "driver/clock/line_bounds.hpp"

#include <algorithm>

namespace submapd::driver {
namespace {

// Beyond any time in microseconds that a process sees, small enough that cuts keep a nanosecond.
constexpr double kUnbounded = 1e13;

}  // namespace

Interval Interval::meet(const Interval& other) const {
  return {std::max(low, other.low), std::min(high, other.high)};
}

LineBounds::LineBounds(const Options& options) : options_(options) {
  rebuild();
}

void LineBounds::reset(const Interval& slope) {
  if (!slope.empty()) {
    options_.slope_low = slope.low;
    options_.slope_high = slope.high;
  }
  upper_.size = 0;
  lower_.size = 0;
  newest_x_ = 0.0;
  any_ = false;
  rebuild();
}

void LineBounds::below(double x, double bound) {
  if (any_ && at(x).high <= bound) return;  // says nothing new
  add(upper_, x, bound);
}

void LineBounds::above(double x, double bound) {
  if (any_ && at(x).low >= bound) return;
  add(lower_, x, -bound);
}

Interval LineBounds::at(double x) const {
  if (corners_ == 0) return {-kUnbounded, kUnbounded};
  const double dx = x - newest_x_;
  Interval range{kUnbounded, -kUnbounded};
  for (std::size_t i = 0; i < corners_; ++i) {
    const double y = polygon_[i].value + polygon_[i].slope * dx;
    range = {std::min(range.low, y), std::max(range.high, y)};
  }
  const double bent = 0.5 * options_.bend * dx * dx;
  return {range.low - bent, range.high + bent};
}

Interval LineBounds::slope() const {
  if (corners_ == 0) return {options_.slope_low, options_.slope_high};
  Interval range{polygon_[0].slope, polygon_[0].slope};
  for (std::size_t i = 1; i < corners_; ++i) {
    range = {std::min(range.low, polygon_[i].slope), std::max(range.high, polygon_[i].slope)};
  }
  return range;
}

// Positive if b lies below the line from a to c, all lifted: a corner of the lower hull.
double LineBounds::turn(const Point& a, const Point& b, const Point& c) const {
  return (lifted(c) - lifted(a)) * (b.x - a.x) - (lifted(b) - lifted(a)) * (c.x - a.x);
}

void LineBounds::add(Hull& hull, double x, double bound) {
  const Point point{x, bound};
  std::size_t& size = hull.size;
  if (size > 0 && x <= hull.points[size - 1].x) {
    if (x < hull.points[size - 1].x || bound >= hull.points[size - 1].y) return;
    --size;  // the same x, a tighter bound
  }
  while (size >= 2 && turn(hull.points[size - 2], hull.points[size - 1], point) <= 0.0) --size;
  const auto begin = hull.points.begin();
  const auto end = begin + static_cast<std::ptrdiff_t>(size);
  const auto fresh = std::find_if(begin, end, [&](const Point& p) { return p.x >= x - options_.horizon; });
  size = static_cast<std::size_t>(std::move(fresh, end, begin) - begin);
  if (size == kHull) drop_least(hull);
  hull.points[size++] = point;
  newest_x_ = any_ ? std::max(newest_x_, x) : x;
  any_ = true;
  rebuild();
}

// Leaves out the corner that stands out least: the one whose triangle with its neighbours is the flattest.
void LineBounds::drop_least(Hull& hull) const {
  std::size_t least = 1;
  double flattest = kUnbounded;
  for (std::size_t i = 1; i + 1 < hull.size; ++i) {
    const Point& a = hull.points[i - 1];
    const Point& c = hull.points[i + 1];
    const double height = turn(a, hull.points[i], c) / (c.x - a.x);
    if (height < flattest) {
      flattest = height;
      least = i;
    }
  }
  std::move(hull.points.begin() + static_cast<std::ptrdiff_t>(least) + 1,
            hull.points.begin() + static_cast<std::ptrdiff_t>(hull.size),
            hull.points.begin() + static_cast<std::ptrdiff_t>(least));
  --hull.size;
}

// The polygon at newest_x_: the range of slopes, cut by every bound that is kept.
void LineBounds::rebuild() {
  polygon_[0] = {-kUnbounded, options_.slope_low};
  polygon_[1] = {kUnbounded, options_.slope_low};
  polygon_[2] = {kUnbounded, options_.slope_high};
  polygon_[3] = {-kUnbounded, options_.slope_high};
  corners_ = 4;
  // Newest first: they cut most, and the polygon stays small.
  for (std::size_t i = upper_.size; i-- > 0;) cut(upper_.points[i].x - newest_x_, upper_.points[i].y, 1.0);
  for (std::size_t i = lower_.size; i-- > 0;) cut(lower_.points[i].x - newest_x_, lower_.points[i].y, -1.0);
}

// Keeps what satisfies sign * (value + slope * dx) <= bound + bend dx^2 / 2 (Sutherland, Hodgman 1974).
void LineBounds::cut(double dx, double bound, double sign) {
  const double limit = bound + 0.5 * options_.bend * dx * dx;
  const auto excess = [&](const Corner& c) { return sign * (c.value + c.slope * dx) - limit; };
  std::array<Corner, kCorners> kept;
  std::size_t count = 0;
  for (std::size_t i = 0; i < corners_; ++i) {
    const Corner& from = polygon_[i];
    const Corner& to = polygon_[(i + 1) % corners_];
    const double a = excess(from);
    const double b = excess(to);
    if (a <= 0.0) kept[count++] = from;
    if ((a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0)) {
      const double share = a / (a - b);
      kept[count++] = {from.value + share * (to.value - from.value), from.slope + share * (to.slope - from.slope)};
    }
  }
  std::copy_n(kept.begin(), count, polygon_.begin());
  corners_ = count;
}

}  // namespace submapd::driver
