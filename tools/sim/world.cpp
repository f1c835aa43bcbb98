#include "tools/sim/world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace submapd::tools {
namespace {

constexpr double kSlack_m = 1e-6;         // cells list walls this far outside them, so that rounding never loses a hit
constexpr double kMaxWorldCells = 4.0e6;  // bound of the grid's memory
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

std::optional<double> intersect(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
                                const Segment& segment) {
  constexpr double kEndSlack = 1e-12;  // two walls that share a corner leave no gap
  const Eigen::Vector2d along = segment.b - segment.a;
  const double determinant = cross(direction, along);
  if (determinant == 0.0) {
    return std::nullopt;
  }
  const Eigen::Vector2d to_a = segment.a - origin;
  const double t = cross(to_a, along) / determinant;
  const double u = cross(to_a, direction) / determinant;
  if (!(t >= 0.0) || !(u >= -kEndSlack && u <= 1.0 + kEndSlack)) {
    return std::nullopt;
  }
  return t;
}

double distance_to(const Segment& segment, const Eigen::Vector2d& point) {
  const Eigen::Vector2d along = segment.b - segment.a;
  const double length2 = along.squaredNorm();
  const double u = length2 > 0.0 ? std::clamp((point - segment.a).dot(along) / length2, 0.0, 1.0) : 0.0;
  return (segment.a + u * along - point).norm();
}

World::World(std::vector<Segment> segments) : segments_(std::move(segments)) {
  if (segments_.empty()) {
    return;
  }
  low_ = high_ = segments_.front().a;
  for (const Segment& segment : segments_) {
    low_ = low_.cwiseMin(segment.a).cwiseMin(segment.b);
    high_ = high_.cwiseMax(segment.a).cwiseMax(segment.b);
  }
  const Eigen::Vector2d extent = (high_ - low_).array() + 4.0 * kSlack_m;
  // About as many cells as walls keeps lists short; never so many that memory grows without bound.
  const double area = extent.x() * extent.y();
  cell_m_ = std::clamp(std::sqrt(area / (4.0 * static_cast<double>(segments_.size()))), 0.1, 4.0);
  cell_m_ = std::max({cell_m_, std::sqrt(area / kMaxWorldCells), extent.maxCoeff() / 1.0e6});
  low_.array() -= 2.0 * kSlack_m;
  high_.array() += 2.0 * kSlack_m;
  columns_ = static_cast<int>(std::floor(extent.x() / cell_m_)) + 1;
  rows_ = static_cast<int>(std::floor(extent.y() / cell_m_)) + 1;

  first_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  const auto for_each_cell = [this](const Segment& segment, auto&& visit) {
    const int column_end = column_of(std::max(segment.a.x(), segment.b.x()) + kSlack_m);
    const int row_end = row_of(std::max(segment.a.y(), segment.b.y()) + kSlack_m);
    for (int row = row_of(std::min(segment.a.y(), segment.b.y()) - kSlack_m); row <= row_end; ++row) {
      for (int column = column_of(std::min(segment.a.x(), segment.b.x()) - kSlack_m); column <= column_end; ++column) {
        if (touches(segment, column, row)) {
          visit(cell_of(column, row));
        }
      }
    }
  };
  for (const Segment& segment : segments_) {
    for_each_cell(segment, [this](std::size_t cell) { ++first_[cell + 1]; });
  }
  for (std::size_t cell = 1; cell < first_.size(); ++cell) {
    first_[cell] += first_[cell - 1];
  }
  entries_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  for (std::size_t i = 0; i < segments_.size(); ++i) {
    for_each_cell(segments_[i], [&](std::size_t cell) { entries_[next[cell]++] = static_cast<std::uint32_t>(i); });
  }
}

std::size_t World::cell_of(int column, int row) const {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
}

int World::column_of(double x) const {
  return static_cast<int>(std::clamp(std::floor((x - low_.x()) / cell_m_), 0.0, columns_ - 1.0));
}

int World::row_of(double y) const {
  return static_cast<int>(std::clamp(std::floor((y - low_.y()) / cell_m_), 0.0, rows_ - 1.0));
}

bool World::touches(const Segment& segment, int column, int row) const {
  // Separating axis: the wall's normal (the box's own axes are the loop bounds of the caller).
  const Eigen::Vector2d centre = low_ + cell_m_ * Eigen::Vector2d(column + 0.5, row + 0.5);
  const Eigen::Vector2d along = segment.b - segment.a;
  const double half = 0.5 * cell_m_ + kSlack_m;
  const double reach = half * (std::abs(along.x()) + std::abs(along.y()));
  return std::abs(cross(along, centre - segment.a)) <= reach + kSlack_m * along.norm();
}

std::optional<RayHit> World::cast(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
                                  double range_max_m) const {
  if (segments_.empty()) {
    return std::nullopt;
  }
  // Clip the ray to the box of the grid.
  double enter = 0.0;
  double leave = range_max_m;
  for (int axis = 0; axis < 2; ++axis) {
    if (direction[axis] == 0.0) {
      if (origin[axis] < low_[axis] || origin[axis] > high_[axis]) {
        return std::nullopt;
      }
      continue;
    }
    const double t0 = (low_[axis] - origin[axis]) / direction[axis];
    const double t1 = (high_[axis] - origin[axis]) / direction[axis];
    enter = std::max(enter, std::min(t0, t1));
    leave = std::min(leave, std::max(t0, t1));
  }
  if (!(enter <= leave)) {
    return std::nullopt;
  }
  const Eigen::Vector2d start = origin + enter * direction;
  int column = column_of(start.x());
  int row = row_of(start.y());
  const int column_step = direction.x() > 0.0 ? 1 : -1;
  const int row_step = direction.y() > 0.0 ? 1 : -1;
  const auto border = [&](int axis, int cell) {
    const double edge = low_[axis] + cell_m_ * (direction[axis] > 0.0 ? cell + 1 : cell);
    return direction[axis] == 0.0 ? kInfinity : (edge - origin[axis]) / direction[axis];
  };

  double best = range_max_m;
  std::optional<std::uint32_t> best_segment;
  while (true) {
    const std::size_t cell = cell_of(column, row);
    for (std::uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
      const std::optional<double> t = intersect(origin, direction, segments_[entries_[i]]);
      if (t && (*t < best || (*t == best && !best_segment))) {
        best = *t;
        best_segment = entries_[i];
      }
    }
    const double next_column = border(0, column);
    const double next_row = border(1, row);
    const double exit = std::min(next_column, next_row);
    if ((best_segment && best <= exit) || exit > leave) {
      break;
    }
    if (next_column <= next_row) {
      column += column_step;
      if (column < 0 || column >= columns_) {
        break;
      }
    } else {
      row += row_step;
      if (row < 0 || row >= rows_) {
        break;
      }
    }
  }
  if (!best_segment) {
    return std::nullopt;
  }
  const Eigen::Vector2d along = (segments_[*best_segment].b - segments_[*best_segment].a).normalized();
  return RayHit{best, *best_segment, std::abs(cross(direction, along))};
}

double World::clearance(const Eigen::Vector2d& point, double limit_m) const {
  double nearest = limit_m;
  if (segments_.empty()) {
    return nearest;
  }
  const int column_end = column_of(point.x() + limit_m);
  const int row_end = row_of(point.y() + limit_m);
  for (int row = row_of(point.y() - limit_m); row <= row_end; ++row) {
    for (int column = column_of(point.x() - limit_m); column <= column_end; ++column) {
      const std::size_t cell = cell_of(column, row);
      for (std::uint32_t i = first_[cell]; i < first_[cell + 1]; ++i) {
        nearest = std::min(nearest, distance_to(segments_[entries_[i]], point));
      }
    }
  }
  return nearest;
}

}  // namespace submapd::tools
