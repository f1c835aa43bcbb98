// All straight lines that bounds on a slowly bending quantity leave possible: its value and its slope as intervals.
//
// The quantity is y(x) with slopes in a given range and |y''| <= bend. Each call of below() or above() gives one bound
// at one x. What is left is a convex polygon of (value, slope) at the newest x: no distribution is assumed, an outlier
// on the loose side of a bound costs nothing, and the width of an interval is an honest error. The classical one-way
// skew estimator (Moon, Skelly, Towsley, INFOCOM 1999; Zhang, Liu, Xia, INFOCOM 2002) with two hulls, made to bend:
//
//   y(x_i) <= u_i and |y''| <= bend  =>  value + slope (x_i - x) <= u_i + bend (x - x_i)^2 / 2
//
// The square, up to terms linear in x_i, is bend x_i^2 / 2 for every x: the bounds that matter for any x are the
// corners of one convex hull of (x_i, u_i + bend x_i^2 / 2), which grows on its right end only.
//
// Fixed memory, no allocation, one thread. Leaving a bound out is always sound, so old and unimportant ones are.
#pragma once

#include <array>
#include <cstddef>

namespace submapd::driver {

struct Interval {
  double low = 0.0;
  double high = 0.0;

  [[nodiscard]] double middle() const { return low + 0.5 * (high - low); }
  [[nodiscard]] double width() const { return high - low; }
  [[nodiscard]] bool empty() const { return low > high; }
  [[nodiscard]] Interval meet(const Interval& other) const;
};

class LineBounds {
 public:
  struct Options {
    double slope_low = -1.0;  // range of dy/dx
    double slope_high = 1.0;
    double bend = 0.0;     // |d2y/dx2| at most
    double horizon = 1e9;  // bounds older than this are forgotten, in x
  };
  explicit LineBounds(const Options& options);

  // y(x) <= bound, y(x) >= bound. Bounds must come in the order of x; one that does not is left out.
  void below(double x, double bound);
  void above(double x, double bound);

  // Range of y at x, of dy/dx at the newest x. Wide, but never empty, where no bound was given.
  [[nodiscard]] Interval at(double x) const;
  // The same where dy/dx at the newest x is also known from elsewhere.
  [[nodiscard]] Interval at(double x, const Interval& slope) const;
  [[nodiscard]] Interval slope() const;
  // An estimate of y(x), no bound: the line that touches the upper bounds from below in the middle of the last `reach`.
  // Right where bounds given to below() are now and then exact.
  [[nodiscard]] double touching(double x, double reach) const;
  [[nodiscard]] double newest_x() const { return newest_x_; }

  // True if the bounds contradict each other: the quantity does not keep its promises. reset() is the only way out.
  [[nodiscard]] bool contradictory() const { return polygon_.size == 0; }
  // Forgets what was given to above().
  void forget_lower();
  // Forgets all bounds. `slope` replaces the range of slopes if it is not empty.
  void reset(const Interval& slope = {1.0, -1.0});

 private:
  static constexpr std::size_t kHull = 48;
  static constexpr std::size_t kCorners = 2 * kHull + 8;

  struct Point {
    double x;
    double y;  // the bound itself, not lifted; mirrored (-bound) in the hull of lower bounds
  };
  // Corners of the lower convex hull of the lifted points, x ascending.
  struct Hull {
    std::array<Point, kHull> points;
    std::size_t size = 0;
  };
  struct Corner {
    double value;
    double slope;
  };
  // Convex, corners in order around it.
  struct Polygon {
    std::array<Corner, kCorners> corners;
    std::size_t size = 0;
    // Keeps what satisfies a * value + b * slope <= limit.
    void cut(double a, double b, double limit);
  };

  void add(Hull& hull, double x, double bound);
  [[nodiscard]] double lifted(const Point& p) const { return p.y + 0.5 * options_.bend * p.x * p.x; }
  [[nodiscard]] double turn(const Point& a, const Point& b, const Point& c) const;
  void drop_least(Hull& hull) const;
  void rebuild();
  [[nodiscard]] Interval reach(const Polygon& polygon, double x) const;

  Options options_;
  Hull upper_;
  Hull lower_;
  double newest_x_ = 0.0;
  bool any_ = false;
  Polygon polygon_;  // of what is possible at newest_x_
};

}  // namespace submapd::driver
