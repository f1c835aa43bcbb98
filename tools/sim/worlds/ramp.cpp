// Two halls on two levels, joined by two ramps: the plane of the scan tilts on ramps and door sills.
#include <algorithm>

#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kHallStream = 0x52414D50;
constexpr double kHall_m = 18.0;
constexpr double kEast_m = 46.0;  // where the upper hall begins
constexpr double kDepth_m = 16.0;
constexpr double kRampAt_m[2] = {3.5, 12.5};
constexpr double kHalfWidth_m = 1.5;
constexpr double kSill_m = 0.012;

// 1.2 m up over 20 m, 6 %; sills of 6 cm at the doors of both halls.
std::shared_ptr<const Floor> ramps() {
  std::vector<Eigen::Vector2d> knots;
  const auto sill = [&](double x, double height) {
    for (const auto& [dx, dz] : {std::pair{-0.04, 0.0}, {-0.02, kSill_m}, {0.02, kSill_m}, {0.04, 0.0}}) {
      knots.emplace_back(x + dx, height + dz);
    }
  };
  sill(kHall_m, 0.0);
  knots.emplace_back(22.0, 0.0);
  knots.emplace_back(42.0, 1.2);
  sill(kEast_m, 1.2);
  return std::make_shared<const Floor>(std::move(knots));
}

void furnish_hall(Draughtsman& d, CounterRandom& random, double west) {
  d.movable(true);
  for (double x = west + 2.0; x < west + 17.0; x += random.uniform(2.5, 4.0)) {
    d.box(x, random.uniform(0.4, 0.9), random.uniform(0.8, 2.0), 0.6);
    d.box(x, kDepth_m - random.uniform(0.4, 0.9), random.uniform(0.8, 2.0), 0.6);
    const double along_lane_m = std::min(x - west, kHall_m - (x - west));
    if (along_lane_m < 5.5) {
      continue;  // the cart's way from ramp to ramp
    }
    d.box(x, 8.0 + random.uniform(-1.2, 1.2), random.uniform(0.5, 1.4), random.uniform(0.5, 1.0),
          random.uniform(-20.0, 20.0));
  }
  d.movable(false);
  d.box(west + 6.0, 5.5, 0.4, 0.4);
  d.box(west + 12.0, 10.6, 0.4, 0.4);
}

}  // namespace

Site build_ramp(std::uint64_t seed) {
  Draughtsman d;
  std::vector<Opening> doors;
  for (const double y : kRampAt_m) {
    doors.push_back({y - 0.9, y + 0.9, 0.0});
  }
  for (const double west : {0.0, kEast_m}) {
    d.wall(0.0, west, west + kHall_m);
    d.wall(kDepth_m, west, west + kHall_m);
    d.wall(west, 0.0, kDepth_m, west > 0.0 ? doors : std::vector<Opening>{}, true);
    d.wall(west + kHall_m, 0.0, kDepth_m, west > 0.0 ? std::vector<Opening>{} : doors, true);
    CounterRandom random(seed, kHallStream, west > 0.0 ? 1 : 0);
    furnish_hall(d, random, west);
  }
  for (const double y : kRampAt_m) {
    d.wall(y - kHalfWidth_m, kHall_m, kEast_m, {{24.0, 25.0, -0.3}, {33.0, 34.5, -0.25}, {39.0, 40.0, -0.3}});
    d.wall(y + kHalfWidth_m, kHall_m, kEast_m, {{21.0, 22.2, 0.3}, {28.5, 29.4, 0.3}, {36.5, 37.6, 0.25}});
    for (double x = 20.0; x < kEast_m; x += 4.6) {
      d.round(x, y + kHalfWidth_m - 0.14, 0.03, 8);  // posts of the handrail
    }
  }
  Site site;
  site.furniture = d.furniture();
  site.walls = d.take();
  site.floor = ramps();
  site.area_m2 = 2.0 * kHall_m * kDepth_m + 2.0 * (kEast_m - kHall_m) * 2.0 * kHalfWidth_m;
  site.people = 6;
  for (const double y : kRampAt_m) {
    site.walkways.push_back({{{4.0, y}, {kEast_m + 14.0, y}}, 0.6});
  }
  // Up one ramp, down the other, twice, and once the other way round.
  const double x0 = 4.0;
  const double x1 = kEast_m + 14.5;
  site.route.waypoints = {{x0, 3.5},  {x1, 3.5},  {x1, 12.5}, {x0, 12.5}, {x0, 3.5}, {x1, 3.5},
                          {x1, 12.5}, {x0, 12.5}, {x1, 12.5}, {x1, 3.5},  {x0, 3.5}, {x0, 10.0}};
  site.route.smoothing_m = 0.8;
  site.route.jitter_m = 0.08;
  return site;
}

}  // namespace submapd::tools
