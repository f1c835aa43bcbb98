// Branch and bound over (x, y, angle): the best placement of b's surface points on a's score plane (design notes 9.1).
//
// Exact while its budget of nodes lasts: the result is that of trying every placement of the window. Deterministic:
// integer scores, fixed order, a budget that is counted and not timed.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/loop/internal/match_grid.hpp"

namespace submapd::internal {

struct SearchWindow {
  Pose2 centre;  // a_from_b
  double half_x_m = 0.0;
  double half_y_m = 0.0;
  std::vector<double> yaws_rad;  // of a_from_b, to be tried
};

struct Placement {
  Pose2 a_from_b;
  std::int32_t score = 0;  // sum of 0..255 over the points
  bool exhausted = false;  // the budget ended the search: score bounds what it may have missed
};

// Placements around a found one that are not distinct from it.
struct ExclusionZone {
  Pose2 centre;
  double radius_m = 0.5;
  double radius_rad = 0.0873;  // 5 deg
};

// Angles from low to high whose neighbours move a point at radius_m by one cell (Hess et al. 2016).
[[nodiscard]] std::vector<double> angle_steps(double low_rad, double high_rad, double cell_m, double radius_m);

class PlacementSearch {
 public:
  // Points in b's frame. The plane and grid of a must outlive the search.
  PlacementSearch(const CellPlane& plane, const MatchGrid& grid, const std::vector<Eigen::Vector2d>& points,
                  const SearchWindow& window);

  // The best placement with score >= threshold and outside the zone, if there is one. When the budget runs out: the
  // best so far; with a zone and none so far, a placement that could not be excluded, with its bound as score.
  [[nodiscard]] std::optional<Placement> best(std::int32_t threshold, const ExclusionZone* zone) const;

 private:
  struct Node {
    std::int32_t bound = 0;
    std::uint32_t angle = 0;
    int x = 0;  // offsets in cells: covers [x, x + 2^level) x [y, y + 2^level)
    int y = 0;
  };
  struct Best;

  // The points at one angle: of cells_ those from `first`, `inside` and then `border` of them.
  struct Turned {
    std::size_t first;
    std::size_t inside;
    std::size_t border;
  };

  void turn_points(const CellPlane& plane, const std::vector<Eigen::Vector2d>& points);
  [[nodiscard]] PointCells points_at(std::uint32_t angle) const {
    const Turned& turned = turned_[angle];
    const PointCell* first = cells_.data() + turned.first;
    return {{first, turned.inside}, {first + turned.inside, turned.border}};
  }
  [[nodiscard]] Pose2 pose_of(const Node& node) const;
  [[nodiscard]] bool excluded(const Node& node, int level, const ExclusionZone& zone) const;
  void descend(const Node& node, int level, Best& best) const;

  const MatchGrid& grid_;
  SearchWindow window_;
  double cell_m_;
  int half_x_;  // cells
  int half_y_;
  std::vector<PointCell> cells_;  // by angle, without those that no offset takes to the plane
  std::vector<Turned> turned_;
  std::vector<Node> roots_;  // best bound first
};

}  // namespace submapd::internal
