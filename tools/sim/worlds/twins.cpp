// Buildings that hold the same place twice.
#include "slam/base/random.hpp"
#include "tools/sim/draughtsman.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kRoomStream = 0x5457494E;
constexpr double kWingLength_m = 36.0;
constexpr double kRoomWidth_m = 6.0;  // along the wing's corridor
constexpr double kRoomDepth_m = 5.0;
constexpr double kHalfWidth_m = 1.1;  // of the corridors
constexpr double kWingAt_m[2] = {10.0, 46.0};
constexpr double kLink_m = 56.0;

// One room to the side of a wing's corridor whose middle is x = 0; `stream` says how it is furnished.
void draw_room(Draughtsman& d, std::uint64_t seed, std::uint64_t stream, double side, double y) {
  CounterRandom random(seed, kRoomStream, stream);
  const double x0 = side * (kHalfWidth_m + 0.3);
  const auto x_at = [&](double deep) { return x0 + side * deep; };
  d.desk(x_at(3.6), y + random.uniform(1.0, 1.6), side > 0.0 ? 90.0 : 270.0);
  d.office_chair(x_at(2.6), y + random.uniform(1.0, 1.7), random.uniform(0.0, 72.0));
  d.box(x_at(4.3), y + random.uniform(3.6, 4.6), 0.5, random.uniform(0.8, 1.8));
  d.box(x_at(random.uniform(1.2, 2.0)), y + 5.5, random.uniform(0.8, 1.6), 0.45);
  d.chair(x_at(random.uniform(2.6, 3.2)), y + random.uniform(4.4, 5.0), random.uniform(0.0, 90.0));
  if (random.uniform() < 0.5) {
    d.round(x_at(0.5), y + 0.6, random.uniform(0.15, 0.28), 9);
  }
}

// A wing along y from y = 0 on. `wing` 1 differs from wing 0 in one room of its twelve and in a box in the corridor.
void draw_wing(Draughtsman& d, std::uint64_t seed, std::uint64_t wing) {
  std::vector<Opening> doors;
  for (double y = 0.0; y < kWingLength_m - 1e-9; y += kRoomWidth_m) {
    doors.push_back(door(y + 3.0));
  }
  std::uint64_t room = 0;
  for (const double side : {-1.0, 1.0}) {
    d.wall(side * kHalfWidth_m, 0.0, kWingLength_m, doors, true);
    d.wall(side * (kHalfWidth_m + kRoomDepth_m), 0.0, kWingLength_m, {}, true);
    for (double y = 0.0; y < kWingLength_m - 1e-9; y += kRoomWidth_m, ++room) {
      d.wall(y, side < 0.0 ? -kHalfWidth_m - kRoomDepth_m : kHalfWidth_m,
             side < 0.0 ? -kHalfWidth_m : kHalfWidth_m + kRoomDepth_m);
      draw_room(d, seed, room == 4 ? room + 100 * wing : room, side, y);
    }
  }
  d.wall(kWingLength_m, -kHalfWidth_m - kRoomDepth_m, kHalfWidth_m + kRoomDepth_m);
  d.box(0.85, 14.5 + 6.3 * static_cast<double>(wing), 0.4, 0.5);
}

// Floor of 32 x 22 m: a ring corridor around a core, rooms on its outside, openings to the lift in the west and east.
const Eigen::Vector2d kFloor_m(32.0, 22.0);
constexpr double kFloorApart_m = 44.0;
constexpr double kWallHalf_m = 0.07;
constexpr double kLiftHalf_m = 1.0;

void draw_floor(Draughtsman& d, std::uint64_t seed) {
  const Opening lift{11.0 - kLiftHalf_m, 11.0 + kLiftHalf_m, 0.0};
  for (const double y : {0.0, kFloor_m.y()}) {
    d.wall(y, 0.0, kFloor_m.x());
  }
  for (const double x : {0.0, kFloor_m.x()}) {
    d.wall(x, 0.0, kFloor_m.y(), {lift}, true);
  }
  // Corridor: 1.8 m wide round the core of 7..25 x 7..15.
  d.wall(7.0, 7.0, 25.0, {{12.0, 13.0, 0.4}});
  d.wall(15.0, 7.0, 25.0, {{18.0, 19.4, -0.4}});
  d.wall(7.0, 7.0, 15.0, {}, true);
  d.wall(25.0, 7.0, 15.0, {{12.0, 12.9, -0.3}}, true);
  d.wall(4.8, 4.8, 27.2, {door(7.6), door(12.0), door(17.0), {19.2, 20.0, -0.3}, door(24.0)});
  d.wall(17.2, 4.8, 27.2, {door(8.0), door(11.0), {13.6, 14.8, 0.35}, door(20.6)});
  for (const double x : {4.8, 27.2}) {
    d.wall(x, 4.8, 17.2, {lift}, true);
  }
  for (const double x : {0.0, 9.6, 14.4, 20.4}) {
    d.wall(x == 0.0 ? 4.8 : x, 0.0, 4.8, {}, true);
    d.wall(x == 0.0 ? 4.8 : x, 17.2, kFloor_m.y(), {}, true);
  }
  for (const double x : {0.0, 27.2}) {
    d.wall(4.8, x, x + 4.8);
    d.wall(17.2, x, x + 4.8);
  }
  CounterRandom random(seed, kRoomStream, 1000);
  for (const double x : {5.6, 10.4, 15.2, 21.4}) {
    d.desk(x + 0.9, 0.9, 180.0);
    d.office_chair(x + random.uniform(0.6, 1.4), 1.8, random.uniform(0.0, 72.0));
    d.box(x + random.uniform(2.9, 3.4), 0.6, 1.0, 0.5);
    d.desk(x + random.uniform(0.9, 1.3), 20.8);
    d.chair(x + random.uniform(2.8, 3.4), 20.6, random.uniform(0.0, 90.0));
    d.box(x - 0.5, random.uniform(18.6, 19.6), 0.5, 0.9);
  }
  d.box(5.1, 8.0, 0.3, 0.8);
  d.round(24.6, 16.9, 0.18, 9);
}

// Way into a wing with its middle at x and back, with a look into two rooms.
void add_wing(std::vector<Eigen::Vector2d>& way, double x, double first_y, double second_y) {
  for (const double y : {first_y, second_y}) {
    const double side = y > 20.0 ? 1.0 : -1.0;
    way.insert(way.end(), {{x, y}, {x + side * 3.0, y}, {x, y}});
  }
  way.insert(way.end(), {{x, kWingLength_m - 1.6}, {x, 0.0}});
}

}  // namespace

Site build_twin_wings(std::uint64_t seed) {
  Draughtsman d;
  for (std::uint64_t wing = 0; wing < 2; ++wing) {
    Draughtsman drawn;
    draw_wing(drawn, seed, wing);
    d.copy(drawn.segments(), {kWingAt_m[wing], 0.0});
  }
  // The link along the south of both: y -2.2 .. 0.
  const double corridor_y = -kHalfWidth_m;
  d.wall(-2.0 * kHalfWidth_m, 0.0, kLink_m,
         {{6.0, 7.2, -0.4}, {20.0, 21.5, -0.3}, {30.5, 31.4, -0.5}, {50.0, 51.0, -0.3}});
  d.wall(0.0, 0.0, kWingAt_m[0] - kHalfWidth_m);
  d.wall(0.0, kWingAt_m[0] + kHalfWidth_m, kWingAt_m[1] - kHalfWidth_m, {{24.0, 25.2, 0.35}, {33.0, 34.6, 0.45}});
  d.wall(0.0, kWingAt_m[1] + kHalfWidth_m, kLink_m);
  d.wall(0.0, -2.0 * kHalfWidth_m, 0.0, {}, true);
  d.wall(kLink_m, -2.0 * kHalfWidth_m, 0.0, {}, true);
  d.box(27.0, -1.95, 0.9, 0.35);
  d.round(38.0, -0.25, 0.17, 10);

  Site site;
  site.walls = d.take();
  site.area_m2 = 2.0 * kWingLength_m * 2.0 * (kHalfWidth_m + kRoomDepth_m) + kLink_m * 2.0 * kHalfWidth_m;
  site.people = 8;
  site.walkways.push_back({{{1.0, corridor_y}, {kLink_m - 1.0, corridor_y}}, 0.6});
  std::vector<Eigen::Vector2d>& way = site.route.waypoints;
  way = {{4.0, corridor_y}};
  const auto link_to = [&](double x) { way.emplace_back(x, corridor_y); };
  const double rooms[2][2] = {{9.0, 27.0}, {15.0, 33.0}};
  for (const auto& visit : rooms) {
    for (const double x : kWingAt_m) {
      link_to(x);
      add_wing(way, x, visit[0], visit[1]);
      link_to(x);
    }
  }
  link_to(kWingAt_m[0]);
  for (const double x : kWingAt_m) {
    site.walkways.push_back({{{x, 0.0}, {x, kWingLength_m - 1.0}}, 0.6});
  }
  site.route.closed = true;
  site.route.smoothing_m = 0.6;
  site.route.jitter_m = 0.05;
  return site;
}

Site build_identical_floors(std::uint64_t seed) {
  Draughtsman floor;
  draw_floor(floor, seed);
  Draughtsman d;
  for (const double x : {0.0, kFloorApart_m}) {
    d.copy(floor.segments(), {x, 0.0});
  }
  // What stands for the lift: a plain passage from the east end of one floor to the west end of the other.
  const double east = kFloor_m.x();
  d.line({east + kWallHalf_m, 11.0 - kLiftHalf_m}, {kFloorApart_m - kWallHalf_m, 11.0 - kLiftHalf_m});
  d.line({east + kWallHalf_m, 11.0 + kLiftHalf_m}, {kFloorApart_m - kWallHalf_m, 11.0 + kLiftHalf_m});

  Site site;
  site.walls = d.take();
  site.area_m2 = 2.0 * kFloor_m.x() * kFloor_m.y() + (kFloorApart_m - east) * 2.0 * kLiftHalf_m;
  site.people = 8;
  std::vector<Eigen::Vector2d>& way = site.route.waypoints;
  const auto round = [&](double x) {
    way.insert(way.end(), {{x + 5.9, 11.0},
                           {x + 5.9, 5.9},
                           {x + 17.0, 5.9},
                           {x + 17.0, 2.6},
                           {x + 17.0, 5.9},
                           {x + 26.1, 5.9},
                           {x + 26.1, 16.1},
                           {x + 11.0, 16.1},
                           {x + 11.0, 19.4},
                           {x + 11.0, 16.1},
                           {x + 5.9, 16.1},
                           {x + 5.9, 5.9},
                           {x + 26.1, 5.9},
                           {x + 26.1, 11.0}});
    site.walkways.push_back(
        {{{x + 5.9, 5.9}, {x + 26.1, 5.9}, {x + 26.1, 16.1}, {x + 5.9, 16.1}, {x + 5.9, 5.9}}, 0.4});
  };
  way = {{3.0, 11.0}};
  round(0.0);
  way.emplace_back(kFloorApart_m - 1.0, 11.0);
  round(kFloorApart_m);
  way.insert(way.end(), {{kFloorApart_m + 26.1, 16.1},
                         {kFloorApart_m + 5.9, 16.1},
                         {kFloorApart_m + 5.9, 11.0},
                         {east, 11.0},
                         {26.1, 11.0},
                         {26.1, 16.1},
                         {5.9, 16.1},
                         {5.9, 11.0},
                         {3.4, 11.0}});
  site.route.smoothing_m = 0.6;
  site.route.jitter_m = 0.05;
  return site;
}

}  // namespace submapd::tools
