// A world of straight walls that the simulator's laser sees: exact ray casting and clearance.
//
// Metres, any frame. A uniform grid of cells lists the walls that touch each cell; a ray walks the cells it crosses
// (Amanatides and Woo 1987) and stops at the first cell whose nearest hit lies inside it. Immutable: any thread may
// ask.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

namespace submapd::tools {

// What a beam meets, see beam.hpp.
enum class Surface : std::uint8_t { kMatt, kGlass, kMirror };

struct Segment {
  Eigen::Vector2d a;
  Eigen::Vector2d b;
  Surface surface = Surface::kMatt;
};

struct RayHit {
  double range_m = 0.0;
  std::uint32_t segment = 0;   // index into World::segments()
  double cos_incidence = 0.0;  // 1: the wall is met head on; 0: grazing
};

// Distance along the ray from origin in the unit vector direction to the segment, nothing if they do not meet.
// Two parallel lines never meet. Cramer's rule on origin + t d = a + u (b - a).
[[nodiscard]] std::optional<double> intersect(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
                                              const Segment& segment);

// Distance of a point to a segment.
[[nodiscard]] double distance_to(const Segment& segment, const Eigen::Vector2d& point);

class World {
 public:
  // REQUIRES: every coordinate finite. Segments of no length are kept but never hit. No segment: an empty world.
  explicit World(std::vector<Segment> segments);

  // Nearest wall along the ray within range_max_m. REQUIRES: direction of unit length.
  [[nodiscard]] std::optional<RayHit> cast(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
                                           double range_max_m) const;

  // Distance to the nearest wall, limit_m if none is nearer.
  [[nodiscard]] double clearance(const Eigen::Vector2d& point, double limit_m) const;

  [[nodiscard]] const std::vector<Segment>& segments() const { return segments_; }
  [[nodiscard]] const Eigen::Vector2d& low() const { return low_; }    // corner of the box around all walls
  [[nodiscard]] const Eigen::Vector2d& high() const { return high_; }  // opposite corner

 private:
  [[nodiscard]] std::size_t cell_of(int column, int row) const;
  [[nodiscard]] int column_of(double x) const;
  [[nodiscard]] int row_of(double y) const;
  [[nodiscard]] bool touches(const Segment& segment, int column, int row) const;

  std::vector<Segment> segments_;
  Eigen::Vector2d low_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d high_ = Eigen::Vector2d::Zero();
  double cell_m_ = 1.0;
  int columns_ = 0;
  int rows_ = 0;
  // Walls of cell c: entries_[first_[c]] .. entries_[first_[c + 1]).
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> entries_;
};

}  // namespace submapd::tools
