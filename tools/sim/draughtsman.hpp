// Draws the walls and the furniture of built-in worlds: what a laser sees at its height, as wall segments.
//
// Metres and degrees. Legs of tables and chairs are drawn, not their tops.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "tools/sim/world.hpp"

namespace submapd::tools {

// An opening along a wall: a door, or a niche that is closed behind.
struct Opening {
  double from = 0.0;  // along the wall, m
  double to = 0.0;
  double niche_m = 0.0;  // depth of the niche, negative on the other side; 0: a door
};

// Door of the usual width.
[[nodiscard]] Opening door(double centre);

// Walls [first, last) of a drawing that make one piece of furniture.
using Piece = std::pair<std::size_t, std::size_t>;

class Draughtsman {
 public:
  // What is drawn from now on is furniture that may be moved, or is not. A call of one of the functions below draws one
  // piece.
  void movable(bool yes) { movable_ = yes; }
  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, Surface surface = Surface::kMatt) {
    segments_.push_back({a, b, surface});
  }
  void box(double x, double y, double width, double depth, double yaw_deg = 0.0);
  void round(double x, double y, double radius, int corners = 10);
  // Closed outline around (x, y), turned.
  void shape(double x, double y, const std::vector<Eigen::Vector2d>& outline, double yaw_deg);

  // Wall along x at height y (or, with vertical, along y at x) with its openings in ascending order.
  void wall(double at, double from, double to, const std::vector<Opening>& openings = {}, bool vertical = false);
  // Panes of glass between posts of 6 cm, about every 2.4 m.
  void glass_front(const Eigen::Vector2d& a, const Eigen::Vector2d& b);

  // Table: four legs, 5 cm.
  void table(double x, double y, double width, double depth, double yaw_deg = 0.0);
  // Table of 1.6 x 0.8 m with a chest of drawers under its right end and a modesty panel at the back.
  void desk(double x, double y, double yaw_deg = 0.0);
  // Four thin legs.
  void chair(double x, double y, double yaw_deg = 0.0) { table(x, y, 0.5, 0.5, yaw_deg); }
  // Swivel chair: column and five feet.
  void office_chair(double x, double y, double yaw_deg = 0.0);
  void conference_table(double x, double y, double width, double depth, int chairs_a_side);

  [[nodiscard]] const std::vector<Segment>& segments() const { return segments_; }
  [[nodiscard]] std::vector<Segment> take() { return std::move(segments_); }
  [[nodiscard]] const std::vector<Piece>& furniture() const { return furniture_; }
  // Draws what another one has drawn, moved by an offset.
  void copy(const std::vector<Segment>& segments, const Eigen::Vector2d& offset);

 private:
  class Drawing;
  void part(double x, double y, double dx, double dy, double width, double depth, double yaw_deg);

  std::vector<Segment> segments_;
  std::vector<Piece> furniture_;
  bool movable_ = false;
  int depth_ = 0;  // of pieces within pieces
};

// The same walls after a while: a quarter of the furniture stands up to 0.3 m elsewhere, a tenth is gone.
[[nodiscard]] std::vector<Segment> move_furniture(const std::vector<Segment>& walls,
                                                  const std::vector<Piece>& furniture, std::uint64_t seed);

}  // namespace submapd::tools
