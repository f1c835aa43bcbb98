#include "slam/loop/internal/placement_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "slam/base/floor_to_int.hpp"

namespace submapd::internal {
namespace {

constexpr int kMaxNodes = 25'000;  // opened in one search; some 75 ms

std::int16_t clamp_cell(double cell) {
  constexpr double kLimit = 16000.0;  // far outside any plane, and room for the offsets
  return static_cast<std::int16_t>(floor_to_int(std::clamp(cell, -kLimit, kLimit)));
}

}  // namespace

struct PlacementSearch::Best {
  std::int32_t score = 0;  // to be exceeded
  bool found = false;
  int budget = kMaxNodes;  // nodes that may still be opened
  Node node;
  const ExclusionZone* zone = nullptr;
};

std::vector<double> angle_steps(double low_rad, double high_rad, double cell_m, double radius_m) {
  const double step = std::acos(1.0 - cell_m * cell_m / (2.0 * std::max(radius_m * radius_m, cell_m * cell_m)));
  const int count = static_cast<int>(std::ceil((high_rad - low_rad) / step));
  std::vector<double> angles;
  angles.reserve(static_cast<std::size_t>(count) + 1);
  for (int i = 0; i <= count; ++i) {
    angles.push_back(count == 0 ? low_rad : low_rad + (high_rad - low_rad) * i / count);
  }
  return angles;
}

PlacementSearch::PlacementSearch(const CellPlane& plane, const MatchGrid& grid,
                                 const std::vector<Eigen::Vector2d>& points, const SearchWindow& window)
    : grid_(grid),
      window_(window),
      cell_m_(plane.cell_m()),
      half_x_(static_cast<int>(std::ceil(window.half_x_m / plane.cell_m()))),
      half_y_(static_cast<int>(std::ceil(window.half_y_m / plane.cell_m()))) {
  turn_points(plane, points);
  const int top = grid_.levels() - 1;
  const int step = 1 << top;
  for (std::uint32_t angle = 0; angle < window_.yaws_rad.size(); ++angle) {
    for (int y = -half_y_; y <= half_y_; y += step) {
      for (int x = -half_x_; x <= half_x_; x += step) {
        roots_.push_back({grid_.sum(top, points_at(angle), x, y), angle, x, y});
      }
    }
  }
  std::stable_sort(roots_.begin(), roots_.end(), [](const Node& l, const Node& r) { return l.bound > r.bound; });
}

void PlacementSearch::turn_points(const CellPlane& plane, const std::vector<Eigen::Vector2d>& points) {
  cells_.reserve(window_.yaws_rad.size() * points.size());
  turned_.reserve(window_.yaws_rad.size());
  // The last roots and their children reach past the window by less than two steps; scores and bounds beyond the plane
  // by less than two more.
  const int step = 1 << (grid_.levels() - 1);
  const int reach_x = half_x_ + 2 * step;
  const int reach_y = half_y_ + 2 * step;
  const int blur = 2 * step + kScoreReach;
  std::vector<PointCell> border;
  for (const double yaw : window_.yaws_rad) {
    const Eigen::Matrix2d turn = rotation(yaw) / cell_m_;
    const Eigen::Vector2d shift = (window_.centre.translation() - plane.origin()) / cell_m_;
    const std::size_t first = cells_.size();
    border.clear();
    for (const Eigen::Vector2d& point : points) {
      const Eigen::Vector2d place = turn * point + shift;
      const PointCell cell{clamp_cell(place.x()), clamp_cell(place.y())};
      const bool inside = cell.x >= reach_x && cell.x < plane.width() - reach_x && cell.y >= reach_y &&
                          cell.y < plane.height() - reach_y;
      const bool outside = cell.x < -reach_x - blur || cell.x >= plane.width() + reach_x + blur ||
                           cell.y < -reach_y - blur || cell.y >= plane.height() + reach_y + blur;
      if (inside) {
        cells_.push_back(cell);
      } else if (!outside) {
        border.push_back(cell);
      }
    }
    turned_.push_back({first, cells_.size() - first, border.size()});
    cells_.insert(cells_.end(), border.begin(), border.end());
  }
}

Pose2 PlacementSearch::pose_of(const Node& node) const {
  return {window_.centre.x + node.x * cell_m_, window_.centre.y + node.y * cell_m_, window_.yaws_rad[node.angle]};
}

// Whether every placement of the node lies in the zone.
bool PlacementSearch::excluded(const Node& node, int level, const ExclusionZone& zone) const {
  const Pose2 low = pose_of(node);
  if (std::abs(wrap_angle(low.yaw - zone.centre.yaw)) > zone.radius_rad) {
    return false;
  }
  const double side = ((1 << level) - 1) * cell_m_;
  const double far_x = std::max(std::abs(low.x - zone.centre.x), std::abs(low.x + side - zone.centre.x));
  const double far_y = std::max(std::abs(low.y - zone.centre.y), std::abs(low.y + side - zone.centre.y));
  return far_x * far_x + far_y * far_y <= zone.radius_m * zone.radius_m;
}

// Depth first, best child first. REQUIRES: node.bound > best.score.
void PlacementSearch::descend(const Node& node, int level, Best& best) const {
  if (best.zone != nullptr && excluded(node, level, *best.zone)) {
    return;
  }
  if (level == 0) {
    best.score = node.bound;
    best.found = true;
    best.node = node;
    return;
  }
  if (best.budget == 0) {
    return;
  }
  --best.budget;
  const int half = 1 << (level - 1);
  std::array<Node, 4> children{};
  std::size_t count = 0;
  const std::array<std::int32_t, 4> bounds = grid_.sum4(level - 1, points_at(node.angle), node.x, node.y, half);
  for (int i = 0; i < 4; ++i) {
    const int x = node.x + (i & 1) * half;
    const int y = node.y + (i >> 1) * half;
    const bool inside = x <= half_x_ && y <= half_y_;  // the last roots reach past the window
    const std::int32_t bound = bounds[static_cast<std::size_t>(i)];
    if (inside && bound > best.score) {
      children[count++] = {bound, node.angle, x, y};
    }
  }
  std::stable_sort(children.begin(), children.begin() + static_cast<std::ptrdiff_t>(count),
                   [](const Node& l, const Node& r) { return l.bound > r.bound; });
  for (std::size_t i = 0; i < count; ++i) {
    if (children[i].bound > best.score) {
      descend(children[i], level - 1, best);
    }
  }
}

std::optional<Placement> PlacementSearch::best(std::int32_t threshold, const ExclusionZone* zone) const {
  Best best;
  best.score = std::max(threshold, 1) - 1;
  best.zone = zone;
  for (const Node& root : roots_) {
    if (root.bound <= best.score) {
      break;
    }
    if (best.budget == 0 && zone != nullptr && !best.found) {
      return Placement{pose_of(root), root.bound, true};
    }
    descend(root, grid_.levels() - 1, best);
  }
  if (!best.found) {
    return std::nullopt;
  }
  return Placement{pose_of(best.node), best.score};
}

}  // namespace submapd::internal
