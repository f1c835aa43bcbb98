// Floor plans from files: wall segments (CSV) and grey maps (PGM, plain or compressed) become worlds.
//
// CSV: one wall a line, x1,y1,x2,y2 in metres; empty lines and lines that start with # are skipped. PGM: P2 or P5 with up
// to 255 grey levels, first row on top; dark cells are walls, light cells free, what lies between is unknown.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

struct GreyMap {
  int width = 0;
  int height = 0;
  double resolution_m = 0.05;      // side of a cell
  std::vector<std::uint8_t> grey;  // row by row, top row first; 0 black, 255 white

  [[nodiscard]] bool wall(int column, int row) const;  // outside the map: false
  [[nodiscard]] bool free(int column, int row) const;  // outside the map: false
  // Whether the cell at a point is free; the lower left corner of the map is (0, 0).
  [[nodiscard]] bool free_at(const Eigen::Vector2d& point) const;
};

struct FloorPlan {
  World world;   // what the laser sees
  World limits;  // what the cart keeps away from: walls and, in a grey map, the unknown
  GreyMap map;   // of no size if the plan is a list of walls
};

// `name` is the file's, for messages.
[[nodiscard]] Expected<std::vector<Segment>> parse_wall_csv(std::string_view text, const std::string& name);
[[nodiscard]] Expected<GreyMap> parse_pgm(std::string_view bytes, const std::string& name, double resolution_m);

// A list of way-points: x,y a line, in metres.
[[nodiscard]] Expected<std::vector<Eigen::Vector2d>> parse_waypoints(std::string_view text, const std::string& name);

// Borders between cells that are and are not in the set, straight runs joined.
[[nodiscard]] std::vector<Segment> outline(const GreyMap& map, bool (GreyMap::*in_set)(int, int) const);

// A file of at most 256 MiB, decompressed if it is gzip.
[[nodiscard]] Expected<std::string> read_text_file(const std::string& path);

// By the ending of the path: .csv, .pgm or .pgm.gz.
[[nodiscard]] Expected<FloorPlan> load_floor_plan(const std::string& path, double resolution_m);

}  // namespace submapd::tools
