#include "slam/graph/point_pairs.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

double baseline_m(const std::vector<TiePoint>& points, Eigen::Vector2d TiePoint::*side) {
  double longest = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) longest = std::max(longest, (points[i].*side - points[j].*side).norm());
  }
  return longest;
}

}  // namespace

Expected<PointPairPose> relative_pose_of(const std::vector<TiePoint>& points, double sigma_m) {
  const auto bad = [](std::string what) { return failure(StatusCode::kInvalidArgument, std::move(what)); };
  if (points.size() < 2) return bad(fmt::format("{} point pairs; a tie needs two or more", points.size()));
  if (!(sigma_m > 0.0) || !std::isfinite(sigma_m)) return bad("sigma of the points is no positive number");
  Eigen::Vector2d mean_a = Eigen::Vector2d::Zero();
  Eigen::Vector2d mean_b = Eigen::Vector2d::Zero();
  for (const TiePoint& p : points) {
    if (!p.in_a.allFinite() || !p.in_b.allFinite()) return bad("a point is not finite");
    mean_a += p.in_a;
    mean_b += p.in_b;
  }
  const double count = static_cast<double>(points.size());
  mean_a /= count;
  mean_b /= count;
  const double baseline = std::min(baseline_m(points, &TiePoint::in_a), baseline_m(points, &TiePoint::in_b));
  if (!(baseline >= kLeastBaseline_m)) {
    return bad(fmt::format("the points lie within {:.2f} m; their heading needs {:.0f} m between them or more",
                           baseline, kLeastBaseline_m));
  }
  double cross = 0.0;
  double dot = 0.0;
  for (const TiePoint& p : points) {
    const Eigen::Vector2d a = p.in_a - mean_a;
    const Eigen::Vector2d b = p.in_b - mean_b;
    cross += b.x() * a.y() - b.y() * a.x();
    dot += a.dot(b);
  }
  PointPairPose found;
  const double yaw = std::atan2(cross, dot);
  const Eigen::Vector2d origin = mean_a - rotation(yaw) * mean_b;
  found.a_from_b = {origin.x(), origin.y(), yaw};
  // Both ends of a pair err: JᵀJ / (2 sigma²).
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const TiePoint& p : points) {
    const Eigen::Vector2d turned = rotation(yaw) * p.in_b;
    Eigen::Matrix<double, 2, 3> J;
    J << 1.0, 0.0, -turned.y(), 0.0, 1.0, turned.x();
    information += J.transpose() * J / (2.0 * sigma_m * sigma_m);
    found.residual_m.push_back((transform(found.a_from_b, p.in_b) - p.in_a).norm());
  }
  found.covariance = information.inverse();
  return found;
}

}  // namespace submapd
