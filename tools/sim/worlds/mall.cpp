// A shopping mall of 150 x 90 m: two galleries joined by three cross galleries, four rows of shops, glass fronts.
#include <algorithm>
#include <cmath>

#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kShopStream = 0x4D414C4C;
constexpr std::uint64_t kGalleryStream = 0x4D414C4D;
constexpr double kLength_m = 150.0;
constexpr double kDepth_m = 90.0;
constexpr double kShopDoor_m = 2.4;
constexpr double kVisit_m = 10.0;  // how deep the cart goes into a shop

// A row of shops with its fronts on a line along x; the shops lie towards `back_y`.
struct Row {
  double from_x = 0.0;
  double to_x = 0.0;
  double front_y = 0.0;
  double back_y = 0.0;
};

constexpr Row kRows[] = {
    {0.0, kLength_m, 18.0, 0.0}, {9.0, 66.0, 28.0, 44.0},   {84.0, 141.0, 28.0, 44.0},
    {9.0, 66.0, 62.0, 46.0},     {84.0, 141.0, 62.0, 46.0}, {0.0, kLength_m, 72.0, kDepth_m},
};

struct Door {
  double x = 0.0;
  double front_y = 0.0;
  double inside_y = 0.0;
};

// Shelves, racks and a counter; the lane behind the door stays free.
void furnish_shop(Draughtsman& d, CounterRandom& random, double left, double right, const Door& door, double back_y) {
  d.movable(true);
  const double inwards = back_y > door.front_y ? 1.0 : -1.0;
  const double depth = std::abs(back_y - door.front_y);
  const auto y_at = [&](double deep) { return door.front_y + inwards * deep; };
  d.box(std::clamp(door.x + random.uniform(-2.0, 2.0), left + 1.6, right - 1.6), y_at(depth - 1.6), 2.6, 0.7);
  for (double x = left + 0.5; x < right - 0.4; x += random.uniform(1.5, 2.6)) {
    if (std::abs(x - door.x) < 1.5) {
      continue;
    }
    for (double deep = 1.6; deep < depth - 3.6;) {
      const double length = random.uniform(0.8, 3.2);
      const double gap = random.uniform(0.9, 2.0);
      const double draw = random.uniform();
      if (draw < 0.6) {
        d.box(x, y_at(deep + length / 2), random.uniform(0.35, 0.9), length);
      } else if (draw < 0.8) {
        d.round(x, y_at(deep + 0.6), random.uniform(0.25, 0.5), 9);
      } else {
        d.table(x, y_at(deep + 0.6), 0.9, 0.9, random.uniform(0.0, 90.0));
      }
      deep += length + gap;
    }
  }
  d.movable(false);
  if (random.uniform() < 0.3) {
    const double x = left + 0.12;  // a mirror on the dividing wall
    d.line({x, y_at(depth - 5.0)}, {x, y_at(depth - 3.0)}, Surface::kMirror);
  }
}

// Front of one shop and where its door is.
Door draw_front(Draughtsman& d, CounterRandom& random, const Row& row, double left, double right) {
  const double inwards = row.back_y > row.front_y ? 1.0 : -1.0;
  Door door{random.uniform(left + 2.2, right - 2.2), row.front_y, row.front_y + inwards * kVisit_m};
  const double a = door.x - kShopDoor_m / 2;
  const double b = door.x + kShopDoor_m / 2;
  const double style = random.uniform();
  if (style < 0.6) {
    d.glass_front({left + 0.2, row.front_y}, {a, row.front_y});
    d.glass_front({b, row.front_y}, {right - 0.2, row.front_y});
    // Behind the panes: dummies and a low wall of goods.
    for (double x = left + 0.8; x < right - 0.8; x += random.uniform(1.0, 2.4)) {
      if (std::abs(x - door.x) > 1.7) {
        d.round(x, row.front_y + inwards * 0.7, random.uniform(0.12, 0.2), 8);
      }
    }
  } else if (style < 0.8) {
    // Open: rolled-up grille between two pillars.
    d.box(left + 0.5, row.front_y, 0.5, 0.4);
    d.box(right - 0.5, row.front_y, 0.5, 0.4);
  } else {
    const double niche = left + 0.6 < a - 1.8 ? 0.35 * inwards : 0.0;
    if (niche != 0.0) {
      d.wall(row.front_y, left, right, {{left + 0.5, left + 1.7, niche}, {a, b, 0.0}});
    } else {
      d.wall(row.front_y, left, right, {{a, b, 0.0}});
    }
  }
  return door;
}

std::vector<Door> draw_row(Draughtsman& d, CounterRandom& random, const Row& row) {
  std::vector<Door> doors;
  double left = row.from_x;
  while (left < row.to_x - 1e-9) {
    double right = left + random.uniform(7.0, 15.0);
    if (row.to_x - right < 7.0) {
      right = row.to_x;
    }
    doors.push_back(draw_front(d, random, row, left, right));
    furnish_shop(d, random, left, right, doors.back(), row.back_y);
    d.box(left, row.front_y, 0.4, 0.5);
    d.wall(left, std::min(row.front_y, row.back_y), std::max(row.front_y, row.back_y), {}, true);
    left = right;
  }
  d.wall(row.to_x, std::min(row.front_y, row.back_y), std::max(row.front_y, row.back_y), {}, true);
  d.wall(row.back_y, row.from_x, row.to_x);
  return doors;
}

// Benches, kiosks, planters in the middle of a gallery, pillars along its sides; those stand free of the cart's lanes.
void furnish_galleries(Draughtsman& d, CounterRandom& random) {
  for (const double y : {23.0, 67.0}) {
    for (double x = 14.0; x < kLength_m - 12.0; x += random.uniform(7.0, 16.0)) {
      if (x > 64.0 && x < 86.0) {
        continue;
      }
      const double draw = random.uniform();
      d.movable(true);
      if (draw < 0.35) {
        d.box(x, y, random.uniform(1.8, 3.0), random.uniform(0.9, 1.5));
      } else if (draw < 0.7) {
        d.box(x, y + random.uniform(-0.3, 0.3), 1.8, 0.5, random.uniform(-8.0, 8.0));
      } else {
        d.round(x, y, random.uniform(0.3, 0.7), 12);
      }
    }
    d.movable(false);
    for (double x = 6.0; x < kLength_m; x += 12.0) {
      const bool crossing = x < 10.0 || x > 140.0 || (x > 64.0 && x < 86.0);
      if (!crossing) {
        d.round(x, y - 4.1, 0.3, 16);
        d.round(x, y + 4.1, 0.3, 16);
      }
    }
  }
  for (const double x : {4.5, 145.5}) {
    for (double y = 32.0; y < 60.0; y += random.uniform(5.0, 9.0)) {
      d.box(x, y, 0.5, 1.8, random.uniform(-5.0, 5.0));
    }
  }
  // Atrium: escalators, a fountain, a cafe on each side.
  for (const double x : {74.2, 75.8}) {
    d.box(x, 44.0, 1.2, 12.0);
  }
  d.round(75.0, 56.5, 1.6, 24);
  d.round(75.0, 33.0, 0.9, 16);
  for (const double x : {67.6, 69.6, 80.6, 82.4}) {
    for (double y = 31.0; y < 60.0; y += random.uniform(2.0, 3.2)) {
      d.round(x, y, 0.05, 6);
      d.chair(x + random.uniform(-0.2, 0.2), y + 0.75, random.uniform(0.0, 90.0));
      d.chair(x + random.uniform(-0.2, 0.2), y - 0.75, random.uniform(0.0, 90.0));
    }
  }
}

// Sides of the middle blocks, on the cross galleries.
void draw_cross_fronts(Draughtsman& d, CounterRandom& random) {
  for (const double x : {9.0, 66.0, 84.0, 141.0}) {
    const double outwards = x == 9.0 || x == 84.0 ? -1.0 : 1.0;
    for (double y = 28.6; y < 60.0; y += 5.2) {
      const double draw = random.uniform();
      if (draw < 0.45) {
        d.glass_front({x + 0.3 * outwards, y}, {x + 0.3 * outwards, y + random.uniform(2.0, 4.6)});
      } else if (draw < 0.75) {
        d.box(x + 0.15 * outwards, y + random.uniform(1.0, 4.0), random.uniform(0.3, 0.5), random.uniform(0.5, 2.0));
      }
    }
  }
}

void draw_shell(Draughtsman& d) {
  d.wall(0.0, 0.0, kDepth_m, {{20.0, 24.0, -0.6}, {40.0, 42.0, -0.3}, {50.0, 51.5, -0.4}, {64.5, 68.5, -0.6}}, true);
  d.wall(kLength_m, 0.0, kDepth_m, {{21.0, 25.0, 0.6}, {37.0, 38.2, 0.4}, {55.0, 58.0, 0.3}, {65.0, 69.0, 0.6}}, true);
  d.wall(44.0, 9.0, 66.0);
  d.wall(46.0, 9.0, 66.0);
}

// A way along the galleries that looks into shops: the way-points of the legs with visits between them.
class TourWriter {
 public:
  TourWriter(const World& world, std::vector<Door> doors) : world_(world), doors_(std::move(doors)) {}

  void go(double x, double y, std::size_t visits = 0) {
    if (!points_.empty() && visits > 0) {
      visit_along(points_.back(), {x, y}, visits);
    }
    points_.emplace_back(x, y);
  }
  [[nodiscard]] std::vector<Eigen::Vector2d> take() { return std::move(points_); }

 private:
  void visit_along(Eigen::Vector2d from, Eigen::Vector2d to, std::size_t visits) {
    std::vector<Door> found;
    for (const Door& door : doors_) {
      const double low = std::min(from.x(), to.x()) + 5.0;
      const double high = std::max(from.x(), to.x()) - 5.0;
      if (door.x > low && door.x < high && std::abs(door.front_y - from.y()) < 9.0 && free(door, from.y())) {
        found.push_back(door);
      }
    }
    std::sort(found.begin(), found.end(),
              [&](const Door& a, const Door& b) { return to.x() > from.x() ? a.x < b.x : a.x > b.x; });
    const std::size_t every = std::max<std::size_t>(1, found.size() / visits);
    double last_x = -kLength_m;
    for (std::size_t i = every / 2; i < found.size() && visits > 0; i += every) {
      const Door& door = found[i];
      if (std::abs(door.x - last_x) < 4.0) {
        continue;
      }
      points_.emplace_back(door.x, from.y());
      points_.emplace_back(door.x, door.inside_y);
      points_.emplace_back(door.x, from.y());
      last_x = door.x;
      --visits;
      doors_.erase(std::find_if(doors_.begin(), doors_.end(),
                                [&](const Door& other) { return other.x == door.x && other.front_y == door.front_y; }));
    }
  }

  [[nodiscard]] bool free(const Door& door, double lane_y) const {
    for (int i = 0; i <= 60; ++i) {
      if (world_.clearance({door.x, lane_y + (door.inside_y - lane_y) * i / 60.0}, 1.0) < 0.7) {
        return false;
      }
    }
    return true;
  }

  const World& world_;
  std::vector<Door> doors_;
  std::vector<Eigen::Vector2d> points_;
};

}  // namespace

Site build_mall(std::uint64_t seed) {
  Draughtsman d;
  std::vector<Door> doors;
  draw_shell(d);
  for (std::size_t i = 0; i < std::size(kRows); ++i) {
    CounterRandom random(seed, kShopStream, i);
    const std::vector<Door> of_row = draw_row(d, random, kRows[i]);
    doors.insert(doors.end(), of_row.begin(), of_row.end());
  }
  CounterRandom random(seed, kGalleryStream, 0);
  furnish_galleries(d, random);
  draw_cross_fronts(d, random);

  Site site;
  site.furniture = d.furniture();
  site.walls = d.take();
  site.area_m2 = kLength_m * kDepth_m;
  site.people = 260;
  for (const double y : {20.5, 23.0, 25.5, 64.5, 67.0, 69.5}) {
    site.walkways.push_back({{{3.0, y}, {147.0, y}}, 1.0});
  }
  for (const double x : {3.0, 6.0, 71.5, 78.5, 144.0, 147.0}) {
    site.walkways.push_back({{{x, 20.0}, {x, 70.0}}, 0.9});
  }
  for (const Door& door : doors) {
    site.walkways.push_back(
        {{{door.x, door.front_y + 0.2 * (door.front_y - door.inside_y)}, {door.x, door.inside_y}}, 0.7});
  }
  const World world(site.walls);
  TourWriter tour(world, doors);
  tour.go(12.0, 21.0);  // once round the outside, counter-clockwise
  tour.go(146.7, 21.0, 5);
  tour.go(146.7, 69.0);
  tour.go(3.3, 69.0, 5);
  tour.go(3.3, 21.0);
  tour.go(78.0, 21.0, 2);  // the western half
  tour.go(78.0, 69.0);
  tour.go(3.3, 69.0, 2);
  tour.go(3.3, 21.0);
  tour.go(146.7, 21.0, 2);  // the eastern half
  tour.go(146.7, 69.0);
  tour.go(72.0, 69.0, 2);
  tour.go(72.0, 25.0);
  tour.go(5.7, 25.0, 2);  // once round, clockwise, in the other lanes
  tour.go(5.7, 65.0);
  tour.go(144.3, 65.0, 4);
  tour.go(144.3, 25.0);
  tour.go(12.0, 25.0, 3);
  site.route.waypoints = tour.take();
  site.route.closed = true;
  site.route.smoothing_m = 0.9;
  site.route.jitter_m = 0.15;
  return site;
}

}  // namespace submapd::tools
