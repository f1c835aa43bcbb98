#include "tools/sim/floor.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace submapd::tools {
namespace {

constexpr double kScanner_m = 0.8;  // of the scan's plane above the floor
constexpr double kCeiling_m = 2.7;  // above the floor
constexpr double kWheelbase_m = 0.8;
constexpr double kTrack_m = 0.5;

}  // namespace

double Floor::height_m(double x) const {
  const auto after = std::upper_bound(knots_.begin(), knots_.end(), x,
                                      [](double at, const Eigen::Vector2d& knot) { return at < knot.x(); });
  if (after == knots_.begin()) {
    return knots_.front().y();
  }
  if (after == knots_.end()) {
    return knots_.back().y();
  }
  const Eigen::Vector2d& before = *(after - 1);
  return before.y() + (after->y() - before.y()) * (x - before.x()) / (after->x() - before.x());
}

Eigen::Vector3d Floor::beam(const Pose2& world_from_base, double angle_rad) const {
  const double c = std::cos(world_from_base.yaw);
  const double s = std::sin(world_from_base.yaw);
  const auto rise = [&](double dx, double dy, double apart_m) {
    return (height_m(world_from_base.x + 0.5 * apart_m * dx) - height_m(world_from_base.x - 0.5 * apart_m * dx)) /
           (apart_m * std::hypot(dx, dy));
  };
  const Eigen::Vector3d ahead = Eigen::Vector3d(c, s, rise(c, s, kWheelbase_m)).normalized();
  Eigen::Vector3d left(-s, c, rise(-s, c, kTrack_m));
  left = (left - left.dot(ahead) * ahead).normalized();
  return std::cos(angle_rad) * ahead + std::sin(angle_rad) * left;
}

std::optional<double> Floor::meet(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction, double rise,
                                  double limit_m) const {
  const double start_m = height_m(origin.x()) + kScanner_m;
  double nearest_m = limit_m;
  bool met = false;
  // Over each straight piece of the floor, the beam's height above it is linear in the way.
  const auto try_piece = [&](double x, double height, double slope, double from_x, double to_x) {
    for (const double above : {0.0, kCeiling_m}) {
      const double gap = start_m - (height + slope * (origin.x() - x)) - above;
      const double closing = slope * direction.x() - rise;
      const double way_m = closing == 0.0 ? -1.0 : gap / closing;
      const double met_x = origin.x() + way_m * direction.x();
      if (way_m > 0.0 && way_m < nearest_m && met_x >= from_x && met_x <= to_x) {
        nearest_m = way_m;
        met = true;
      }
    }
  };
  constexpr double kFar = std::numeric_limits<double>::infinity();
  try_piece(knots_.front().x(), knots_.front().y(), 0.0, -kFar, knots_.front().x());
  try_piece(knots_.back().x(), knots_.back().y(), 0.0, knots_.back().x(), kFar);
  for (std::size_t i = 1; i < knots_.size(); ++i) {
    const Eigen::Vector2d step = knots_[i] - knots_[i - 1];
    try_piece(knots_[i - 1].x(), knots_[i - 1].y(), step.y() / step.x(), knots_[i - 1].x(), knots_[i].x());
  }
  return met ? std::optional(nearest_m) : std::nullopt;
}

}  // namespace submapd::tools
