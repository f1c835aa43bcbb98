// A car park of 96 x 64 m: columns on a grid, four lanes between rows of bays, parked cars, few walls.
#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kCarStream = 0x434152;
constexpr double kLength_m = 96.0;
constexpr double kDepth_m = 64.0;
constexpr double kAisle_m = 16.0;  // bays of 5 m on both sides of a lane of 6 m
constexpr double kBay_m = 2.5;
constexpr double kOccupied[4] = {0.45, 0.15, 0.04, 0.3};  // of the bays, by lane: some lanes hold columns only

// Body at the height of bumpers; x along the bay.
void draw_car(Draughtsman& d, CounterRandom& random, double x, double y, bool nose_up) {
  const double l = random.uniform(3.7, 4.8) / 2;
  const double w = random.uniform(1.65, 1.9) / 2;
  const double chamfer = random.uniform(0.15, 0.4);
  d.shape(x + random.uniform(-0.15, 0.15), y + random.uniform(-0.15, 0.15),
          {{-l, -w + chamfer},
           {-l + chamfer, -w},
           {l - chamfer, -w},
           {l, -w + chamfer},
           {l, w - chamfer},
           {l - chamfer, w},
           {-l + chamfer, w},
           {-l, w - chamfer}},
          (nose_up ? 90.0 : -90.0) + random.uniform(-3.0, 3.0));
}

bool cross_lane(double x) {
  return x < 7.0 || x > kLength_m - 7.0 || (x > 44.0 && x < 52.0);
}

}  // namespace

Site build_car_park(std::uint64_t seed) {
  Draughtsman d;
  CounterRandom random(seed, kCarStream, 0);
  for (int aisle = 0; aisle < 4; ++aisle) {
    const double y = kAisle_m * aisle;
    for (double x = 7.0 + kBay_m / 2; x < kLength_m - 7.0; x += kBay_m) {
      for (const bool upper : {false, true}) {
        if (!cross_lane(x - kBay_m / 2) && !cross_lane(x + kBay_m / 2) && random.uniform() < kOccupied[aisle]) {
          d.movable(true);
          draw_car(d, random, x, upper ? y + 13.5 : y + 2.5, upper);
          d.movable(false);
        }
      }
    }
    for (double x = 7.0; x <= kLength_m - 7.0; x += 3.0 * kBay_m) {
      d.box(x, y + 4.6, 0.4, 0.5);
      d.box(x, y + kAisle_m - 4.6, 0.4, 0.5);
    }
  }
  // Parapets are low: only pieces of wall and the columns between them are seen.
  for (double x = 0.0; x <= kLength_m; x += 12.0) {
    d.box(x, 0.0, 0.4, 0.4);
    d.box(x, kDepth_m, 0.4, 0.4);
  }
  for (double y = 0.0; y <= kDepth_m; y += 16.0) {
    d.box(kLength_m, y, 0.4, 0.4);
  }
  d.wall(0.0, 0.0, 24.0);
  d.wall(0.0, 30.0, kDepth_m, {}, true);
  d.wall(kDepth_m, 72.0, kLength_m);
  // Stairs and lift.
  d.box(2.2, 32.0, 4.0, 5.0);
  d.box(93.0, 50.0, 3.0, 6.5);

  Site site;
  site.furniture = d.furniture();
  site.walls = d.take();
  site.area_m2 = kLength_m * kDepth_m;
  site.people = 10;
  for (const double y : {8.0, 24.0, 40.0, 56.0}) {
    site.walkways.push_back({{{2.0, y}, {kLength_m - 2.0, y}}, 2.0});
  }
  for (const double x : {48.0, 90.0}) {
    site.walkways.push_back({{{x, 3.0}, {x, kDepth_m - 3.0}}, 1.0});
  }
  // Lane by lane to and fro, home by the middle, then the other way round.
  site.route.waypoints = {{6.0, 7.0},   {90.0, 7.0},  {90.0, 23.0}, {6.0, 23.0},  {6.0, 39.0}, {90.0, 39.0},
                          {90.0, 57.0}, {6.0, 57.0},  {6.0, 41.0},  {47.0, 41.0}, {47.0, 9.0}, {6.0, 9.0},
                          {6.0, 25.0},  {49.0, 25.0}, {49.0, 55.0}, {90.0, 55.0}, {90.0, 9.0}, {8.0, 9.0}};
  site.route.closed = true;
  site.route.smoothing_m = 2.0;
  site.route.jitter_m = 0.3;
  return site;
}

}  // namespace submapd::tools
