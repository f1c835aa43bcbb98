#include "driver/clock/line_bounds.hpp"

#include <algorithm>
#include <cmath>

namespace submapd::driver {
namespace {

// Beyond any time in microseconds that a process sees, small enough that cuts keep a nanosecond.
constexpr double kUnbounded = 1e13;

// A bound that narrows what was possible by less is not worth its place. Without this, a rotor in step with the crystal
// (as emulated ones are) gives two new corners a scan, and a scan costs 30 us instead of 5.
double hardly_news(const Interval& before) {
  constexpr double kShare = 0.01;
  return before.width() < kUnbounded ? kShare * before.width() : 0.0;
}

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

void LineBounds::forget_lower() {
  lower_.size = 0;
  rebuild();
}

void LineBounds::below(double x, double bound) {
  const Interval before = at(x);
  if (any_ && before.high - bound <= hardly_news(before)) return;
  add(upper_, x, bound);
}

void LineBounds::above(double x, double bound) {
  const Interval before = at(x);
  if (any_ && bound - before.low <= hardly_news(before)) return;
  add(lower_, x, -bound);
}

Interval LineBounds::at(double x) const {
  return reach(polygon_, x);
}

Interval LineBounds::at(double x, const Interval& slope) const {
  Polygon both = polygon_;
  both.cut(0.0, 1.0, slope.high);
  both.cut(0.0, -1.0, -slope.low);
  return reach(both.size == 0 ? polygon_ : both, x);
}

Interval LineBounds::reach(const Polygon& polygon, double x) const {
  if (polygon.size == 0) return {-kUnbounded, kUnbounded};
  const double dx = x - newest_x_;
  Interval range{kUnbounded, -kUnbounded};
  for (std::size_t i = 0; i < polygon.size; ++i) {
    const double y = polygon.corners[i].value + polygon.corners[i].slope * dx;
    range = {std::min(range.low, y), std::max(range.high, y)};
  }
  const double bent = 0.5 * options_.bend * dx * dx;
  return {range.low - bent, range.high + bent};
}

Interval LineBounds::slope() const {
  if (polygon_.size == 0) return {options_.slope_low, options_.slope_high};
  Interval range{polygon_.corners[0].slope, polygon_.corners[0].slope};
  for (std::size_t i = 1; i < polygon_.size; ++i) {
    const double slope = polygon_.corners[i].slope;
    range = {std::min(range.low, slope), std::max(range.high, slope)};
  }
  return range;
}

double LineBounds::touching(double x, double reach) const {
  const auto* const end = upper_.points.data() + upper_.size;
  const auto* first = std::find_if(upper_.points.data(), end, [&](const Point& p) { return p.x >= newest_x_ - reach; });
  if (end - first < 2) return at(x).high;
  const double middle = 0.5 * (first->x + (end - 1)->x);
  const auto* const right = std::find_if(first + 1, end - 1, [&](const Point& p) { return p.x >= middle; });
  const Point& left = *(right - 1);
  const Interval possible = slope();
  const double slope_there = std::clamp((right->y - left.y) / (right->x - left.x), possible.low, possible.high);
  return left.y + slope_there * (x - left.x);
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
  // A first box that the newest bound of each side implies: cuts between corners far away would lose digits.
  const auto extreme = [this](const Hull& hull) {
    if (hull.size == 0) return kUnbounded;
    const Point& p = hull.points[hull.size - 1];
    const double dx = p.x - newest_x_;
    const double steepest = std::max(std::abs(options_.slope_low), std::abs(options_.slope_high));
    return p.y + 0.5 * options_.bend * dx * dx + steepest * std::abs(dx) + 1.0;
  };
  const double high = extreme(upper_);
  const double low = -extreme(lower_);
  polygon_.corners[0] = {low, options_.slope_low};
  polygon_.corners[1] = {high, options_.slope_low};
  polygon_.corners[2] = {high, options_.slope_high};
  polygon_.corners[3] = {low, options_.slope_high};
  polygon_.size = low <= high ? 4 : 0;
  const auto cut = [this](const Point& p, double sign) {
    const double dx = p.x - newest_x_;
    polygon_.cut(sign, sign * dx, p.y + 0.5 * options_.bend * dx * dx);
  };
  // Newest first: they cut most, and the polygon stays small.
  for (std::size_t i = upper_.size; i-- > 0;) cut(upper_.points[i], 1.0);
  for (std::size_t i = lower_.size; i-- > 0;) cut(lower_.points[i], -1.0);
}

// Sutherland and Hodgman 1974.
void LineBounds::Polygon::cut(double a, double b, double limit) {
  const auto excess = [&](const Corner& c) { return a * c.value + b * c.slope - limit; };
  if (std::none_of(corners.begin(), corners.begin() + size, [&](const Corner& c) { return excess(c) > 0.0; })) return;
  Polygon kept;
  for (std::size_t i = 0; i < size; ++i) {
    const Corner& from = corners[i];
    const Corner& to = corners[i + 1 == size ? 0 : i + 1];
    const double here = excess(from);
    const double there = excess(to);
    if (here <= 0.0) kept.corners[kept.size++] = from;
    if ((here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0)) {
      const double share = here / (here - there);
      kept.corners[kept.size++] = {from.value + share * (to.value - from.value),
                                   from.slope + share * (to.slope - from.slope)};
    }
  }
  std::copy_n(kept.corners.begin(), kept.size, corners.begin());
  size = kept.size;
}

}  // namespace submapd::driver
