#include "slam/matching/scan_matcher.hpp"

#include <cmath>

namespace submapd {
namespace {

constexpr double kHeldSigma_m = 1e-4;

// Along a weak axis the field pulls towards where the map ends, i.e. back: the start stands there.
MotionPrior held_along_axis(const MotionPrior& prior, const Pose2& start) {
  MotionPrior held = prior;
  if (!prior.weak.any()) return held;
  const Eigen::Vector2d& a = prior.weak.axis;
  const double off = a.dot(start.translation() - prior.pose.translation());
  held.pose.x += off * a.x();
  held.pose.y += off * a.y();
  held.information.topLeftCorner<2, 2>() += a * a.transpose() / (kHeldSigma_m * kHeldSigma_m);
  return held;
}

}  // namespace

MatchResult match_scan(const ScanPoints& points, const DistanceView& field, const IndexMap& map, const Pose2& start,
                       const MotionPrior& prior, const ScanMatcherOptions& options) {
  MatchResult result =
      match_field(points.thinned(), field, map.cell_m(), start, held_along_axis(prior, start), options.field);
  if (!options.use_lines) return result;
  const LineMatchResult lines =
      match_lines(points.all(), map.surface(), points.angle_step_rad(), result.pose, prior, options.lines);
  const Pose2 shift = between(result.pose, lines.match.pose);
  result.health.line_ratio = lines.match.health.line_ratio;
  if (result.health.line_ratio < options.min_line_ratio || std::hypot(shift.x, shift.y) > options.max_line_shift_m ||
      std::abs(shift.yaw) > options.max_line_shift_rad) {
    return result;
  }
  result.pose = lines.match.pose;
  result.information = lines.match.information;
  result.health.iterations += lines.match.health.iterations;
  return result;
}

KnownFit known_fit(const ScanPoints& points, const DistanceView& field, const IndexMap& map, const Pose2& pose) {
  KnownFit fit;
  const double c = std::cos(pose.yaw);
  const double s = std::sin(pose.yaw);
  constexpr int kNear = 3 * kDistanceUnitsPerCell;  // three cells: 15 cm
  int known = 0;
  int matched = 0;
  int contradicting = 0;
  for (const ScanPoint& p : points.thinned()) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    const CellIndex cell = cell_at(pose.x + c * x - s * y, pose.y + s * x + c * y, 1.0 / map.cell_m());
    const int distance = field.at(cell);
    if (distance <= kNear) {
      ++known;
      ++matched;
    } else if (map.known(cell)) {
      ++known;
      ++contradicting;
    }
  }
  const std::size_t n = points.thinned().size();
  if (n > 0) fit.known_ratio = static_cast<double>(known) / static_cast<double>(n);
  if (known > 0) {
    fit.matched_ratio = static_cast<double>(matched) / known;
    fit.contradiction = static_cast<double>(contradicting) / known;
  }
  return fit;
}

}  // namespace submapd
