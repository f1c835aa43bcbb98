// A pedestrian street of 150 m: a row of house fronts on one side, trees, lamps and then open sky on the other.
#include <algorithm>

#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kHouseStream = 0x5354524545;
constexpr std::uint64_t kOpenStream = 0x5354524546;
constexpr double kLength_m = 150.0;
constexpr double kRoom_m = 7.0;  // depth of the shops that are seen through their windows

// Windows, doors and drain pipes of a house whose front is at y = front.
void draw_house(Draughtsman& d, CounterRandom& random, double left, double right, double front) {
  d.line({left, front - 12.0}, {left, front});
  d.line({right, front}, {right, front - 12.0});
  d.line({left, front - kRoom_m}, {right, front - kRoom_m});
  d.box(left + 0.12, front + 0.06, 0.12, 0.12);
  double x = left;
  while (x < right - 1e-9) {
    const double width = std::min(right - x, random.uniform(1.2, 4.2));
    const double end = x + width;
    const double draw = random.uniform();
    if (draw < 0.35 && width > 1.5) {
      d.glass_front({x, front - 0.1}, {end, front - 0.1});  // shop window
      d.box((x + end) / 2, front - 1.0, width * random.uniform(0.2, 0.7), 0.5);
    } else if (draw < 0.55 && width > 1.4) {
      const double deep = random.uniform(0.4, 1.6);  // entrance
      d.line({x, front}, {x, front - deep});
      d.line({x, front - deep}, {end, front - deep});
      d.line({end, front - deep}, {end, front});
    } else if (draw < 0.8) {
      const double deep = random.uniform(0.1, 0.25);  // recess of a window
      d.line({x, front}, {x + 0.3, front});
      d.line({x + 0.3, front}, {x + 0.3, front - deep});
      d.line({x + 0.3, front - deep}, {end - 0.3, front - deep});
      d.line({end - 0.3, front - deep}, {end - 0.3, front});
      d.line({end - 0.3, front}, {end, front});
    } else {
      d.line({x, front}, {end, front});
    }
    x = end;
  }
}

void draw_houses(Draughtsman& d, std::uint64_t seed) {
  CounterRandom random(seed, kHouseStream, 0);
  double x = -8.0;
  double to_alley = 30.0;
  while (x < kLength_m + 8.0) {
    const double width = random.uniform(7.0, 16.0);
    draw_house(d, random, x, x + width, random.uniform(-0.6, 0.4));
    x += width;
    to_alley -= width;
    if (to_alley < 0.0) {
      x += random.uniform(2.5, 4.0);  // an alley
      to_alley = random.uniform(25.0, 45.0);
    }
  }
}

void draw_open_side(Draughtsman& d, std::uint64_t seed) {
  CounterRandom random(seed, kOpenStream, 0);
  for (double x = 2.0; x < kLength_m; x += random.uniform(7.0, 13.0)) {
    d.round(x, 11.5 + random.uniform(-0.4, 0.4), random.uniform(0.12, 0.3), 12);  // trees
    const double draw = random.uniform();
    if (draw < 0.3) {
      d.box(x + 3.0, 11.0, 1.8, 0.45, random.uniform(-4.0, 4.0));  // bench
    } else if (draw < 0.5) {
      for (int i = 0; i < 4; ++i) {
        d.box(x + 2.0 + 0.7 * i, 10.8, 0.06, 1.6, random.uniform(-12.0, 12.0));  // bicycles
      }
    } else if (draw < 0.65) {
      d.box(x + 3.5, 11.3, 1.6, 1.2);  // planter
    }
  }
  for (double x = 9.0; x < kLength_m; x += 22.0) {
    d.round(x, 5.9, 0.07, 8);  // lamps
  }
  for (double x = -4.0; x < kLength_m + 4.0; x += random.uniform(9.0, 17.0)) {
    d.round(x, random.uniform(15.0, 28.0), random.uniform(0.15, 0.4), 12);  // the park
  }
  for (const double x : {38.0, 104.0}) {
    d.box(x, 9.6, 2.6, 1.8, 4.0);  // kiosks
  }
  d.movable(true);  // tables of a cafe by the wall
  for (double x = 66.0; x < 78.0; x += random.uniform(1.9, 2.6)) {
    d.round(x, 1.4, 0.05, 6);
    d.chair(x - 0.6, 1.3, random.uniform(0.0, 90.0));
    d.chair(x + 0.6, 1.5, random.uniform(0.0, 90.0));
  }
  d.movable(false);
}

}  // namespace

Site build_street(std::uint64_t seed) {
  Draughtsman d;
  draw_houses(d, seed);
  draw_open_side(d, seed);
  Site site;
  site.furniture = d.furniture();
  site.walls = d.take();
  site.area_m2 = kLength_m * 30.0;
  site.people = 60;
  for (const double y : {2.2, 4.5, 7.5, 9.0}) {
    site.walkways.push_back({{{-5.0, y}, {kLength_m + 5.0, y}}, 1.0});
  }
  site.walkways.push_back({{{5.0, 14.0}, {70.0, 19.0}, {145.0, 14.0}}, 2.0});
  // Up by the houses, down by the trees, half the way once more, and back.
  site.route.waypoints = {{3.0, 3.4},  {60.0, 3.4},  {82.0, 3.6}, {146.0, 3.4}, {146.0, 7.4},
                          {70.0, 7.4}, {44.0, 7.2},  {3.0, 7.4},  {3.0, 4.4},   {90.0, 4.4},
                          {96.0, 7.2}, {147.0, 7.2}, {96.0, 7.2}, {90.0, 4.6},  {5.0, 4.6}};
  site.route.closed = true;
  site.route.jitter_m = 0.15;
  return site;
}

}  // namespace submapd::tools
