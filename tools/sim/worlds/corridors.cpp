// Worlds in which walls say little: a ring corridor, and a blank one of 200 m between two furnished rooms.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kRingStream = 0x52494E47;
constexpr double kStraight_m = 55.0;  // of the ring, between its round ends
constexpr double kRadius_m = 14.0;    // of the round ends, to the corridor's middle
constexpr double kHalfWidth_m = 1.25;

constexpr double kCorridor_m = 200.0;
constexpr double kRoom_m = 24.0;  // a run-up to 3 m/s

// The ring by arc length of its middle: place, and direction to the left.
struct RingPlace {
  Eigen::Vector2d middle;
  Eigen::Vector2d left;
};

constexpr double kArc_m = std::numbers::pi * kRadius_m;
constexpr double kRing_m = 2.0 * (kStraight_m + kArc_m);

RingPlace ring_at(double s) {
  const double half = kRing_m / 2.0;
  s = std::fmod(s, kRing_m);
  const double sign = s < half ? 1.0 : -1.0;  // the second half is the first one, turned by 180 degrees
  const double t = s < half ? s : s - half;
  const Eigen::Vector2d centre(kStraight_m / 2.0, 0.0);
  RingPlace place;
  if (t < kStraight_m) {
    place = {{t - kStraight_m / 2.0, -kRadius_m}, {0.0, 1.0}};
  } else {
    const double angle = (t - kStraight_m) / kRadius_m;
    const Eigen::Vector2d outwards(std::sin(angle), -std::cos(angle));
    place = {centre + kRadius_m * outwards, -outwards};
  }
  return {sign * place.middle, sign * place.left};
}

// One side of the ring: plain wall with doors in shallow recesses, now and then a deeper niche or a pilaster.
void draw_ring_side(Draughtsman& d, CounterRandom& random, double side_m) {
  const double outwards = side_m > 0.0 ? 1.0 : -1.0;
  const auto at = [&](double s, double deeper) -> Eigen::Vector2d {
    const RingPlace place = ring_at(s);
    return place.middle + (side_m + outwards * deeper) * place.left;
  };
  const auto along = [&](double from, double to, double deeper) {
    const int pieces = std::max(1, static_cast<int>(std::ceil((to - from) / 1.0)));
    for (int i = 0; i < pieces; ++i) {
      d.line(at(from + (to - from) * i / pieces, deeper), at(from + (to - from) * (i + 1) / pieces, deeper));
    }
  };
  double s = 0.0;
  while (s < kRing_m) {
    const double plain = std::min(kRing_m, s + random.uniform(2.5, 9.0));
    along(s, plain, 0.0);
    const double end = std::min(kRing_m, plain + random.uniform(0.9, 1.3));
    const double draw = random.uniform();
    const double deeper = draw < 0.65 ? random.uniform(0.06, 0.14) : draw < 0.85 ? 0.4 : -0.12;
    d.line(at(plain, 0.0), at(plain, deeper));
    along(plain, end, deeper);
    d.line(at(end, deeper), at(end, 0.0));
    s = end;
  }
}

void furnish_end_room(Draughtsman& d, double x, double sense) {
  d.desk(x + 3.0 * sense, 4.2, 90.0);
  d.office_chair(x + 4.1 * sense, 4.4, 20.0);
  d.box(x + 7.0 * sense, -4.4, 1.8, 0.6);
  d.box(x + 10.9 * sense, 2.6, 0.6, 2.4);
  d.round(x + 4.5 * sense, -3.6, 0.4, 14);
  d.table(x + 8.2 * sense, 3.6, 1.6, 0.8, 25.0);
  d.chair(x + 9.4 * sense, 4.0, 55.0);
  d.box(x + 1.2 * sense, -3.9, 1.4, 0.5, 8.0);
  d.box(x + 10.4 * sense, -3.4, 0.9, 0.9, 33.0);
}

}  // namespace

Site build_ring(std::uint64_t seed) {
  Draughtsman d;
  for (const double side : {kHalfWidth_m, -kHalfWidth_m}) {
    CounterRandom random(seed, kRingStream, side > 0.0 ? 0 : 1);
    draw_ring_side(d, random, side);
  }
  CounterRandom random(seed, kRingStream, 2);
  d.movable(true);
  for (double s = 6.0; s < kRing_m - 6.0; s += random.uniform(18.0, 34.0)) {
    const RingPlace place = ring_at(s);
    const Eigen::Vector2d thing = place.middle + (random.uniform() < 0.5 ? 1.0 : -1.0) * 1.0 * place.left;
    if (random.uniform() < 0.5) {
      d.round(thing.x(), thing.y(), 0.17, 10);
    } else {
      const double yaw_deg = std::atan2(-place.left.x(), place.left.y()) * 180.0 / std::numbers::pi;
      d.box(thing.x(), thing.y(), 0.7, 0.3, yaw_deg);
    }
  }
  Site site;
  site.furniture = d.furniture();
  site.walls = d.take();
  site.area_m2 = kRing_m * 2.0 * kHalfWidth_m;
  site.people = 8;
  Walkway round;
  for (int i = 0; i <= 100; ++i) {
    round.points.push_back(ring_at(kRing_m * i / 100.0).middle);
  }
  round.half_width_m = 0.7;
  site.walkways.push_back(round);
  // Two laps one way, one lap the other.
  constexpr int kStops = 96;
  for (int i = 0; i <= 2 * kStops; ++i) {
    site.route.waypoints.push_back(ring_at(kRing_m * i / kStops).middle);
  }
  for (int i = kStops - 1; i >= 0; --i) {
    site.route.waypoints.push_back(ring_at(kRing_m * i / kStops).middle);
  }
  site.route.smoothing_m = 1.5;
  site.route.jitter_m = 0.1;
  return site;
}

Site build_corridor(std::uint64_t /*seed*/) {
  Draughtsman d;
  d.line({0.0, 1.2}, {kCorridor_m, 1.2});
  d.line({0.0, -1.2}, {kCorridor_m, -1.2});
  for (const double sense : {-1.0, 1.0}) {
    const double x = sense < 0.0 ? 0.0 : kCorridor_m;
    d.line({x, 1.2}, {x, 5.0});
    d.line({x, 5.0}, {x + kRoom_m * sense, 5.0});
    d.line({x + kRoom_m * sense, 5.0}, {x + kRoom_m * sense, -5.0});
    d.line({x + kRoom_m * sense, -5.0}, {x, -5.0});
    d.line({x, -5.0}, {x, -1.2});
    furnish_end_room(d, x, sense);
    furnish_end_room(d, x + 0.5 * kRoom_m * sense, sense);
  }
  Site site;
  site.walls = d.take();
  site.area_m2 = kCorridor_m * 2.4 + 2.0 * kRoom_m * 10.0;
  // At full speed before the room ends: what a cart does that enters while it speeds up, no scan tells.
  site.route.waypoints = {
      {-20.0, -1.5}, {-20.5, 1.5}, {-18.0, 0.0}, {kCorridor_m + 2.0, 0.0}, {kCorridor_m + 6.0, 1.4}};
  return site;
}

Site build_corridor_ripple(std::uint64_t seed) {
  Site site = build_corridor(seed);
  site.ripple = 0.03;
  return site;
}

Site build_corridor_braking(std::uint64_t seed) {
  Site site = build_corridor(seed);
  site.route.slow_places = {{{70.0, 0.0}, 4.0, 0.8}, {{125.0, 0.0}, 2.0, 0.2}, {{150.0, 0.0}, 3.0, 1.2}};
  return site;
}

}  // namespace submapd::tools
