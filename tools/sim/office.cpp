#include "tools/sim/office.hpp"

#include "tools/sim/draughtsman.hpp"

namespace submapd::tools {
namespace {

void draw_walls(Draughtsman& d) {
  // Outer walls.
  d.wall(0.0, 0.0, 40.0);
  d.wall(25.0, 0.0, 40.0);
  d.wall(0.0, 0.0, 25.0, {}, true);
  d.wall(40.0, 0.0, 25.0, {}, true);
  // Long corridors: south y 6..8, north y 16..18.
  d.wall(6.0, 0.0, 40.0,
         {door(5.0),
          {7.8, 8.9, -0.45},
          door(10.5),
          door(16.0),
          {17.6, 18.5, -0.35},
          door(21.0),
          door(25.5),
          door(30.0),
          {32.0, 32.7, -0.5},
          door(35.5)});
  d.wall(8.0, 2.0, 8.0);
  d.wall(8.0, 10.0, 20.0, {door(12.2), {16.4, 17.8, 0.4}});
  d.wall(8.0, 22.0, 31.0, {{23.4, 24.2, 0.3}, {27.2, 29.0, 0.5}});
  d.wall(8.0, 33.0, 38.0);
  d.wall(16.0, 2.0, 8.0, {{4.6, 5.5, -0.4}});
  d.wall(16.0, 10.0, 20.0, {door(13.2), {17.0, 17.9, -0.35}});
  d.wall(16.0, 22.0, 31.0, {{25.0, 26.6, -0.45}});
  d.wall(16.0, 33.0, 38.0);
  d.wall(18.0, 0.0, 40.0,
         {door(6.0),
          {9.4, 10.2, 0.4},
          door(12.0),
          door(17.0),
          door(22.0),
          {23.9, 24.5, 0.3},
          door(26.5),
          door(31.0),
          {32.6, 33.6, 0.4},
          door(36.0)});
  d.wall(2.0, 6.0, 8.0, {}, true);
  d.wall(38.0, 6.0, 8.0, {}, true);
  d.wall(2.0, 16.0, 18.0, {}, true);
  d.wall(38.0, 16.0, 18.0, {}, true);
  // Cross corridors: x 8..10, 20..22, 31..33.
  d.wall(8.0, 8.0, 16.0, {door(9.6), door(14.0)}, true);
  d.wall(10.0, 8.0, 16.0, {{11.0, 12.0, 0.4}}, true);
  d.wall(20.0, 8.0, 16.0, {door(10.4), door(14.6)}, true);
  d.wall(22.0, 8.0, 16.0, {{8.9, 11.5, 0.0}, {13.2, 14.2, 0.5}}, true);
  d.wall(31.0, 8.0, 16.0, {{10.0, 10.8, -0.3}, door(14.0)}, true);
  d.wall(33.0, 8.0, 16.0, {door(10.2), door(14.6)}, true);
  // Between rooms.
  for (const double x : {7.0, 14.0, 18.8, 27.2, 32.8}) {
    d.wall(x, 0.0, 6.0, {}, true);
  }
  for (const double x : {9.0, 14.5, 19.6, 28.2, 34.3}) {
    d.wall(x, 18.0, 25.0, {}, true);
  }
  d.wall(11.8, 0.0, 8.0);
  d.wall(15.0, 8.0, 16.0, {}, true);
  d.wall(12.6, 15.0, 20.0);
  d.wall(12.2, 22.0, 31.0);
  d.wall(12.6, 33.0, 40.0);
}

void furnish_corridors(Draughtsman& d) {
  // Pilasters at uneven distances.
  for (const double x : {3.4, 6.9, 13.6, 19.2, 23.3, 28.1, 34.1, 37.0}) {
    d.box(x, 6.13, 0.34, 0.16);
  }
  for (const double x : {4.4, 11.0, 14.9, 25.6, 30.3, 35.2}) {
    d.box(x, 7.88, 0.3, 0.14);
  }
  for (const double x : {3.2, 7.3, 11.4, 19.2, 23.1, 29.4, 34.6}) {
    d.box(x, 16.12, 0.36, 0.15);
  }
  for (const double x : {4.1, 8.3, 14.3, 19.8, 25.2, 29.0, 37.2}) {
    d.box(x, 17.88, 0.28, 0.13);
  }
  d.box(2.6, 7.5, 0.7, 0.6, 12.0);  // crates in the west end
  d.box(2.5, 6.6, 0.5, 0.5, 40.0);
  d.round(37.4, 7.4, 0.25);  // plant
  d.box(37.3, 6.5, 0.6, 0.4);
  d.box(13.0, 6.33, 0.9, 0.4);  // copier
  d.box(18.9, 7.75, 0.5, 0.35, 8.0);
  d.box(27.4, 6.28, 0.45, 0.3);
  d.round(22.9, 7.68, 0.18, 8);  // water cooler
  d.box(33.6, 7.72, 0.5, 0.4, -9.0);
  d.box(15.6, 16.3, 1.2, 0.35);  // bench
  d.round(10.9, 17.7, 0.19, 8);
  d.box(20.8, 17.72, 0.7, 0.35);
  d.box(28.0, 16.3, 0.5, 0.4, 15.0);
  d.round(34.0, 16.35, 0.22, 9);
  d.box(2.6, 17.4, 0.9, 0.5);
  d.box(37.5, 16.6, 0.5, 0.7);
  d.box(8.22, 11.6, 0.3, 0.6);  // lockers and boxes in the cross corridors
  d.box(9.82, 13.6, 0.2, 0.9);
  d.box(9.76, 9.0, 0.3, 0.3, 20.0);
  d.box(20.2, 12.4, 0.25, 0.8);
  d.round(21.72, 12.4, 0.17, 8);
  d.box(21.8, 15.2, 0.25, 0.5);
  d.box(31.22, 12.2, 0.28, 0.7);
  d.box(32.8, 12.6, 0.24, 0.4);
  d.round(31.3, 8.5, 0.2, 8);
}

void furnish_south_rooms(Draughtsman& d) {
  // Two-desk office.
  d.desk(1.3, 1.2, 90.0);
  d.office_chair(2.3, 1.4, 10.0);
  d.desk(1.3, 4.2, 90.0);
  d.office_chair(2.2, 4.0, 31.0);
  d.box(3.0, 0.35, 1.6, 0.45);
  d.box(6.6, 1.6, 0.45, 2.0);
  d.round(6.5, 5.4, 0.22);
  // Archive: rows of cabinets.
  d.box(8.2, 1.6, 0.5, 2.6);
  d.box(9.2, 1.6, 0.5, 2.4);
  d.box(12.0, 1.9, 0.5, 3.2);
  d.box(13.0, 1.9, 0.5, 3.2);
  d.box(8.0, 5.0, 0.9, 0.6);
  d.chair(12.6, 4.6, 22.0);
  // Copying room.
  d.box(14.5, 1.2, 0.6, 1.4);
  d.box(18.2, 3.4, 0.7, 1.1);
  d.table(16.2, 0.9, 1.8, 0.8);
  d.round(14.6, 5.2, 0.25, 8);
  d.box(18.3, 0.7, 0.8, 0.6, 10.0);
  // Open plan with two doors and a pillar.
  d.box(23.2, 4.6, 0.45, 0.45);
  d.desk(19.7, 1.3, 90.0);
  d.office_chair(20.5, 1.1, 50.0);
  d.desk(22.6, 1.3, 180.0);
  d.desk(24.3, 1.3, 180.0);
  d.office_chair(22.5, 0.6, 12.0);
  d.office_chair(24.4, 0.55, 64.0);
  d.box(26.8, 1.4, 0.45, 1.8);
  d.box(19.2, 4.9, 0.5, 1.2);
  // Director.
  d.desk(29.4, 1.1, 180.0);
  d.office_chair(29.3, 0.5, 0.0);
  d.chair(31.3, 1.6, 200.0);
  d.box(32.2, 3.6, 0.8, 1.8);
  d.round(27.8, 5.3, 0.28);
  d.box(27.6, 2.6, 0.4, 1.6);
  // Laboratory with benches.
  d.box(36.9, 0.45, 4.2, 0.6);
  d.box(39.55, 3.2, 0.6, 3.4);
  d.table(33.9, 2.2, 0.9, 2.4);
  d.round(34.0, 5.3, 0.3, 12);
  d.chair(38.6, 3.9, 35.0);
  d.chair(37.4, 1.4, 5.0);
}

void furnish_middle_rooms(Draughtsman& d) {
  // West: store and single office.
  d.box(0.4, 10.2, 0.5, 2.8);
  d.box(2.4, 11.4, 2.4, 0.5);
  d.box(2.9, 8.35, 2.8, 0.45);
  d.box(3.2, 9.7, 0.7, 0.7, 33.0);
  d.desk(1.2, 13.6, 90.0);
  d.office_chair(2.1, 13.7, 25.0);
  d.box(4.1, 15.65, 2.2, 0.4);
  d.chair(3.9, 12.5, 70.0);
  d.round(7.4, 12.4, 0.24);
  // Training room between the corridors.
  d.table(10.9, 9.9, 0.8, 1.6);
  d.chair(11.1, 11.3, 15.0);
  d.table(14.3, 9.6, 0.8, 1.6);
  d.chair(13.7, 9.9, -14.0);
  d.table(11.2, 13.2, 0.8, 1.6);
  d.chair(11.0, 14.7, 48.0);
  d.box(14.75, 12.5, 0.3, 2.2);
  d.round(10.5, 15.5, 0.2, 8);
  // Server room and small office.
  d.box(16.0, 11.4, 0.7, 1.6);
  d.box(17.6, 11.6, 0.7, 1.2);
  d.box(15.5, 8.8, 0.6, 1.0);
  d.desk(16.2, 13.4, 0.0);
  d.office_chair(16.0, 14.2, 36.0);
  d.box(15.4, 15.4, 0.5, 0.9);
  d.box(18.3, 12.9, 1.4, 0.4);
  // Lounge and kitchen.
  d.box(29.2, 11.75, 3.2, 0.6);
  d.round(26.9, 10.4, 0.5, 14);
  d.chair(26.2, 9.7, 30.0);
  d.chair(27.8, 10.8, 75.0);
  d.box(23.6, 11.7, 2.0, 0.8);
  d.box(29.7, 8.9, 1.9, 0.8, 8.0);
  d.box(25.4, 8.5, 0.5, 0.5);
  // Meeting room.
  d.conference_table(26.2, 14.0, 3.6, 1.4, 4);
  d.box(22.9, 12.6, 1.4, 0.45);
  d.box(30.2, 15.6, 0.9, 0.4);
  d.round(22.6, 15.5, 0.25);
  // East: workshop and print shop.
  d.box(38.9, 12.0, 1.9, 0.7);
  d.box(39.5, 9.4, 0.7, 2.2);
  d.table(36.2, 8.75, 2.2, 0.8);
  d.round(34.1, 12.0, 0.3, 12);
  d.box(36.4, 13.1, 2.4, 0.6);
  d.box(39.4, 14.4, 0.8, 1.4);
  d.round(34.2, 13.2, 0.26);
}

void furnish_north_rooms(Draughtsman& d) {
  // Four-desk office.
  d.desk(1.2, 20.0, 90.0);
  d.desk(1.2, 23.4, 90.0);
  d.office_chair(2.1, 20.3, 0.0);
  d.office_chair(2.2, 23.0, 40.0);
  d.desk(4.3, 24.0, 0.0);
  d.office_chair(4.3, 23.2, 20.0);
  d.desk(8.3, 22.9, 270.0);
  d.office_chair(7.5, 23.1, 55.0);
  d.box(8.6, 19.4, 0.5, 1.6);
  d.box(3.0, 18.35, 1.8, 0.45);
  // Library.
  d.box(9.4, 21.8, 0.4, 4.6);
  d.box(14.1, 22.2, 0.4, 3.4);
  d.box(11.4, 24.6, 2.6, 0.4);
  d.round(13.0, 23.2, 0.45, 12);
  d.chair(12.9, 24.1, 10.0);
  // Rest room with sofas.
  d.box(15.1, 21.4, 0.8, 2.2);
  d.box(17.3, 24.4, 2.4, 0.8);
  d.table(17.2, 22.7, 1.1, 0.7);
  d.round(19.1, 18.8, 0.25);
  d.box(19.2, 22.0, 0.5, 0.9, 12.0);
  // Open plan with pillars and two doors.
  d.box(24.2, 20.3, 0.5, 0.5);
  d.round(24.2, 23.3, 0.28, 16);
  d.desk(20.5, 20.4, 90.0);
  d.desk(20.5, 23.6, 90.0);
  d.office_chair(21.3, 23.4, 15.0);
  d.desk(22.6, 24.2, 0.0);
  d.desk(26.0, 24.2, 0.0);
  d.office_chair(26.1, 23.3, 70.0);
  d.box(27.8, 22.3, 0.45, 2.2);
  d.box(24.3, 18.7, 1.0, 0.4);
  // Drawing office with slanted boards.
  d.table(29.6, 20.6, 1.4, 0.8, 25.0);
  d.table(29.7, 23.4, 1.4, 0.8, 25.0);
  d.office_chair(30.0, 22.3, 33.0);
  d.table(33.0, 23.6, 1.4, 0.8, -25.0);
  d.box(33.9, 20.6, 0.4, 2.6);
  d.box(31.5, 24.6, 1.2, 0.4);
  // Corner meeting room with a round table and a slanted corner.
  d.round(37.6, 23.3, 0.7, 18);
  d.chair(36.4, 23.9, 20.0);
  d.chair(38.8, 22.8, 50.0);
  d.chair(37.5, 22.1, 5.0);
  d.box(39.3, 18.8, 1.6, 0.1, 45.0);
  d.box(34.65, 21.5, 0.4, 2.2);
}

}  // namespace

World office_world() {
  Draughtsman draughtsman;
  draw_walls(draughtsman);
  furnish_corridors(draughtsman);
  furnish_south_rooms(draughtsman);
  furnish_middle_rooms(draughtsman);
  furnish_north_rooms(draughtsman);
  return World(draughtsman.take());
}

Route office_tour() {
  Route route;
  route.closed = true;
  route.smoothing_m = 0.8;
  route.jitter_m = 0.05;
  route.waypoints = {
      {6.0, 7.0},                                                            // start, facing east in the south corridor
      {10.5, 7.0},  {10.5, 3.4},                                             // archive and back
      {10.5, 7.0},  {16.0, 7.0},  {16.0, 3.2},                               // copying room and back
      {16.0, 7.0},  {21.0, 7.0},  {21.0, 3.2},  {25.5, 3.2},                 // through the southern open plan
      {25.5, 7.0},  {32.0, 7.0},  {32.0, 10.2}, {36.6, 10.2},                // workshop and back
      {32.0, 10.2}, {32.0, 17.0}, {26.5, 17.0}, {26.5, 21.8}, {22.0, 21.8},  // round the pillars of the northern one
      {22.0, 17.0}, {9.0, 17.0},  {9.0, 14.0},  {5.0, 14.0},                 // western office and back
      {9.0, 14.0},  {9.0, 7.0},                                              // the first ring closes
      {12.2, 7.0},  {12.2, 10.6}, {13.2, 13.4}, {13.2, 17.0},                // through the training room
      {21.0, 17.0}, {21.0, 10.2}, {24.6, 10.2},                              // lounge and back
      {21.0, 10.2}, {21.0, 7.0},  {30.0, 7.0},  {30.0, 3.0},                 // director and back
      {30.0, 7.0},  {35.5, 7.0},  {35.5, 3.0},                               // laboratory and back
      {35.5, 7.0},  {32.0, 7.0},  {32.0, 14.0}, {29.2, 14.0},                // meeting room and back
      {32.0, 14.0}, {32.0, 17.0}, {36.0, 17.0}, {36.0, 20.8},                // corner room and back
      {36.0, 17.0}, {31.0, 17.0}, {31.0, 21.4},                              // drawing office and back
      {31.0, 17.0}, {17.0, 17.0}, {17.0, 21.0},                              // rest room and back
      {17.0, 17.0}, {12.0, 17.0}, {12.0, 21.4},                              // library and back
      {12.0, 17.0}, {6.0, 17.0},  {6.0, 21.6},                               // four-desk office and back
      {6.0, 17.0},  {9.0, 17.0},  {9.0, 9.6},   {5.2, 9.6},                  // store and back
      {9.0, 9.6},   {9.0, 7.0},   {5.0, 7.0},   {5.0, 3.0},                  // two-desk office and back
      {5.0, 7.0},
  };
  return route;
}

}  // namespace submapd::tools
