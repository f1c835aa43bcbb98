#include "tools/sim/tour_planner.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <queue>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

constexpr double kRoom_m = 1.2;             // more clearance than this is not better
constexpr double kMaxGridCells = 2.0e6;
constexpr double kStraighten_m = 0.12;      // a way's corners that deviate less are dropped
constexpr double kMinClearance_m = 0.3;     // of the driven path
constexpr double kFar = std::numeric_limits<float>::infinity();
constexpr std::uint64_t kStartStream = 0x5354415254;

// In a list of walls nothing says which side is indoors: there, most directions end at a wall.
bool looks_indoors(const World& world, const Eigen::Vector2d& point) {
  constexpr int kDirections = 24;
  constexpr double kReach_m = 80.0;
  int walls = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double angle = 2.0 * std::numbers::pi * (i + 0.3) / kDirections;
    walls += world.cast(point, {std::cos(angle), std::sin(angle)}, kReach_m) ? 1 : 0;
  }
  return walls >= kDirections * 5 / 6;
}

class Grid {
 public:
  Grid(const FloorPlan& plan, double step_m) : low_(plan.limits.low()), step_m_(step_m) {
    const Eigen::Vector2d extent = plan.limits.high() - low_;
    step_m_ = std::max(step_m_, std::sqrt(extent.x() * extent.y() / kMaxGridCells));
    step_m_ = std::max(step_m_, extent.maxCoeff() / 1e5);
    columns_ = static_cast<int>(extent.x() / step_m_) + 1;
    rows_ = static_cast<int>(extent.y() / step_m_) + 1;
    clearance_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), 0.0F);
    for (int cell = 0; cell < count(); ++cell) {
      const Eigen::Vector2d centre = point(cell);
      if (plan.map.width > 0 && !plan.map.free_at(centre)) {
        continue;
      }
      clearance_[index(cell)] = static_cast<float>(plan.limits.clearance(centre, kRoom_m));
    }
    if (plan.map.width == 0) {
      drop_outdoors(plan.world);
    }
  }

  [[nodiscard]] int count() const { return columns_ * rows_; }
  [[nodiscard]] Eigen::Vector2d point(int cell) const {
    return low_ + step_m_ * Eigen::Vector2d(cell % columns_ + 0.5, cell / columns_ + 0.5);
  }

  // Cells of the largest connected area that keeps the clearance, in ascending order.
  [[nodiscard]] std::vector<int> largest_area(double clearance_m) const {
    std::vector<char> seen(clearance_.size(), 0);
    std::vector<int> largest;
    for (int seed = 0; seed < count(); ++seed) {
      if (seen[index(seed)] != 0 || clearance_[index(seed)] < clearance_m) {
        continue;
      }
      std::vector<int> area{seed};
      seen[index(seed)] = 1;
      for (std::size_t i = 0; i < area.size(); ++i) {
        for_each_neighbour(area[i], clearance_m, [&](int next, double /*step*/) {
          if (seen[index(next)] == 0) {
            seen[index(next)] = 1;
            area.push_back(next);
          }
        });
      }
      if (area.size() > largest.size()) {
        largest = std::move(area);
      }
    }
    std::sort(largest.begin(), largest.end());
    return largest;
  }

  struct Ways {
    std::vector<float> cost;  // from the source
    std::vector<int> before;  // cell before this one, -1 at the source
  };

  // Dijkstra from one cell; ways near walls cost up to three times as much.
  [[nodiscard]] Ways ways_from(int source, double clearance_m) const {
    Ways ways{std::vector<float>(clearance_.size(), static_cast<float>(kFar)), std::vector<int>(clearance_.size(), -1)};
    using Entry = std::pair<float, int>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
    ways.cost[index(source)] = 0.0F;
    open.emplace(0.0F, source);
    while (!open.empty()) {
      const auto [cost, cell] = open.top();
      open.pop();
      if (cost > ways.cost[index(cell)]) {
        continue;
      }
      for_each_neighbour(cell, clearance_m, [&, cost = cost, cell = cell](int next, double step) {
        const double narrow = 1.0 - clearance_[index(next)] / kRoom_m;
        const auto reached = static_cast<float>(cost + step * (1.0 + 3.0 * narrow));
        if (reached < ways.cost[index(next)]) {
          ways.cost[index(next)] = reached;
          ways.before[index(next)] = cell;
          open.emplace(reached, next);
        }
      });
    }
    return ways;
  }

 private:
  static std::size_t index(int cell) { return static_cast<std::size_t>(cell); }

  template <typename Visit>
  void for_each_neighbour(int cell, double clearance_m, const Visit& visit) const {
    const int column = cell % columns_;
    const int row = cell / columns_;
    for (int dr = -1; dr <= 1; ++dr) {
      for (int dc = -1; dc <= 1; ++dc) {
        const bool inside = column + dc >= 0 && column + dc < columns_ && row + dr >= 0 && row + dr < rows_;
        if ((dr == 0 && dc == 0) || !inside || clearance_[index(cell + dr * columns_ + dc)] < clearance_m) {
          continue;
        }
        visit(cell + dr * columns_ + dc, step_m_ * std::hypot(dr, dc));
      }
    }
  }

  void drop_outdoors(const World& world) {
    // Asked once for each block of cells, about a metre wide.
    const int block = std::max(1, static_cast<int>(std::lround(1.0 / step_m_)));
    for (int row = 0; row < rows_; row += block) {
      for (int column = 0; column < columns_; column += block) {
        const Eigen::Vector2d centre = low_ + step_m_ * Eigen::Vector2d(column + 0.5 * block, row + 0.5 * block);
        if (looks_indoors(world, centre)) {
          continue;
        }
        for (int r = row; r < std::min(row + block, rows_); ++r) {
          for (int c = column; c < std::min(column + block, columns_); ++c) {
            clearance_[index(r * columns_ + c)] = 0.0F;
          }
        }
      }
    }
  }

  Eigen::Vector2d low_;
  double step_m_;
  int columns_ = 0;
  int rows_ = 0;
  std::vector<float> clearance_;  // m, at most kRoom_m; 0 where the cart must not be
};

// Douglas and Peucker 1973.
void straighten(const std::vector<Eigen::Vector2d>& points, std::size_t first, std::size_t last,
                std::vector<Eigen::Vector2d>& kept) {
  std::size_t farthest = first;
  double deviation = kStraighten_m;
  for (std::size_t i = first + 1; i < last; ++i) {
    const double distance = distance_to({points[first], points[last]}, points[i]);
    if (distance > deviation) {
      deviation = distance;
      farthest = i;
    }
  }
  if (farthest != first) {
    straighten(points, first, farthest, kept);
    straighten(points, farthest, last, kept);
  } else {
    kept.push_back(points[last]);
  }
}

struct Goal {
  int cell = 0;
  Grid::Ways ways;
};

std::vector<Goal> choose_goals(const Grid& grid, const std::vector<int>& area, double clearance_m,
                               const TourOptions& options) {
  CounterRandom random(options.seed, kStartStream, 0);
  const auto start = static_cast<std::size_t>(random.uniform() * static_cast<double>(area.size()));
  std::vector<Goal> goals;
  int next = area[std::min(start, area.size() - 1)];
  std::vector<float> nearest(static_cast<std::size_t>(grid.count()), static_cast<float>(kFar));
  while (static_cast<int>(goals.size()) < options.max_goals) {
    goals.push_back({next, grid.ways_from(next, clearance_m)});
    for (const int cell : area) {
      const auto i = static_cast<std::size_t>(cell);
      nearest[i] = std::min(nearest[i], goals.back().ways.cost[i]);
    }
    next = *std::max_element(area.begin(), area.end(), [&](int a, int b) {
      return nearest[static_cast<std::size_t>(a)] < nearest[static_cast<std::size_t>(b)];
    });
    if (nearest[static_cast<std::size_t>(next)] < options.goal_spacing_m) {
      break;
    }
  }
  return goals;
}

std::vector<Eigen::Vector2d> visit(const Grid& grid, const std::vector<Goal>& goals) {
  std::vector<Eigen::Vector2d> tour{grid.point(goals.front().cell)};
  std::vector<char> visited(goals.size(), 0);
  std::size_t at = 0;
  for (std::size_t step = 0; step < goals.size(); ++step) {
    visited[at] = 1;
    const Goal& from = goals[at];
    std::size_t to = 0;  // after all goals, home
    for (std::size_t i = 0; i < goals.size(); ++i) {
      const auto cost = [&](std::size_t goal) { return from.ways.cost[static_cast<std::size_t>(goals[goal].cell)]; };
      if (visited[i] == 0 && (to == 0 || cost(i) < cost(to))) {
        to = i;
      }
    }
    std::vector<Eigen::Vector2d> way;
    for (int cell = goals[to].cell; cell != -1; cell = from.ways.before[static_cast<std::size_t>(cell)]) {
      way.push_back(grid.point(cell));
    }
    std::reverse(way.begin(), way.end());
    if (way.size() > 1) {
      straighten(way, 0, way.size() - 1, tour);
    }
    at = to;
  }
  return tour;
}

}  // namespace

Expected<Route> plan_tour(const FloorPlan& plan, const TourOptions& options) {
  const Grid grid(plan, options.grid_m);
  // As far from walls as possible without giving up rooms behind narrow doors.
  const std::size_t reachable = grid.largest_area(0.4).size();
  double clearance_m = 0.5;
  std::vector<int> area = grid.largest_area(clearance_m);
  while (clearance_m > 0.42 && area.size() * 10 < reachable * 7) {
    clearance_m -= 0.05;
    area = grid.largest_area(clearance_m);
  }
  if (area.size() < 2) {
    return failure(StatusCode::kInvalidArgument,
                   "plan: no connected free space 0.8 m wide; check the scale, or give --waypoints");
  }
  const std::vector<Goal> goals = choose_goals(grid, area, clearance_m, options);
  Route route;
  route.closed = true;
  route.waypoints = visit(grid, goals);
  // The rounder the corners the better, as long as the cart keeps clear of the walls.
  for (const double smoothing_m : {0.8, 0.5, 0.3, 0.2}) {
    route.smoothing_m = smoothing_m;
    const Expected<Motion> motion = Motion::along(route, {});
    if (!motion) {
      return failure(motion.error());
    }
    if (min_clearance(plan.limits, *motion, kRoom_m) >= kMinClearance_m) {
      return route;
    }
  }
  return failure(StatusCode::kInternal, "plan: the tour comes too close to a wall; give --waypoints");
}

double min_clearance(const World& world, const Motion& motion, double limit_m) {
  constexpr double kStep_s = 0.05;
  double smallest = limit_m;
  for (double time_s = 0.0; time_s < motion.duration_s(); time_s += kStep_s) {
    smallest = std::min(smallest, world.clearance(motion.at(time_s).translation(), limit_m));
  }
  return smallest;
}

}  // namespace submapd::tools
