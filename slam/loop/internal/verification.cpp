#include "slam/loop/internal/verification.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "slam/base/floor_to_int.hpp"

namespace submapd::internal {
namespace {

constexpr double kFitAcross_m = 0.10;
constexpr double kFitAlong_m = 0.25;    // a line reaches that far between the hits of a sparse scan
constexpr double kFitCosine = 0.866;    // 30 deg
constexpr int kOverlapStride = 2;       // cells; a quarter of them measures the area well enough
constexpr std::size_t kMinJudged = 20;  // surface points; fewer prove nothing

bool all_free_around(const CellPlane& plane, const Eigen::Vector2i& cell) {
  return !plane.any_around(cell, [](CellKind kind) { return kind != CellKind::kFree; });
}

bool fits(const SurfaceIndex& target, const Eigen::Vector2d& place, const Eigen::Vector2d& normal) {
  const std::int32_t found = target.closest(place, normal, kFitAlong_m, kFitCosine);
  if (found == SurfaceIndex::kNone) {
    return false;
  }
  const SurfaceElement& mate = target.elements()[static_cast<std::size_t>(found)];
  const Eigen::Vector2d offset = place - mate.mean;
  return mate.line_like() ? std::abs(mate.normal.dot(offset)) <= kFitAcross_m : offset.norm() <= kFitAcross_m;
}

struct Judged {
  std::size_t all = 0;
  std::size_t fitting = 0;
  std::size_t contradicted = 0;
};

// Where a cell's neighbours alone are known, the other sub-map ends: it may have seen the wall's other side, or less.
Judged judge_elements(const SurfaceIndex& points, const SubmapView& target, const Pose2& target_from_points) {
  Judged judged;
  const Eigen::Matrix2d turn = rotation(target_from_points.yaw);
  for (const SurfaceElement& element : points.elements()) {
    if (!element.lasting) continue;
    const Eigen::Vector2d place = turn * element.mean + target_from_points.translation();
    const Eigen::Vector2i cell = target.plane->cell_at(place);
    if (target.plane->kind(cell.x(), cell.y()) == CellKind::kUnknown) continue;
    ++judged.all;
    judged.fitting += fits(target.surface, place, turn * element.normal) ? 1 : 0;
    judged.contradicted += all_free_around(*target.plane, cell) ? 1 : 0;
  }
  return judged;
}

double share(std::size_t part, std::size_t whole) {
  return whole < kMinJudged ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

Overlap measure_overlap(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b) {
  // From cells of b to cells of a.
  const Eigen::Matrix2d turn = rotation(a_from_b.yaw) * (b.plane->cell_m() / a.plane->cell_m());
  const Eigen::Vector2d first = transform(a_from_b, b.plane->centre_of(0, 0)) - a.plane->origin();
  const Eigen::Vector2d shift = first / a.plane->cell_m();
  std::size_t common = 0;
  for (int y = 0; y < b.plane->height(); y += kOverlapStride) {
    const std::span<const CellKind> row = b.plane->row(y);
    const Eigen::Vector2d start = shift + y * turn.col(1);
    for (int x = 0; x < b.plane->width(); x += kOverlapStride) {
      if (row[static_cast<std::size_t>(x)] == CellKind::kUnknown) {
        continue;
      }
      const Eigen::Vector2d place = start + x * turn.col(0);
      common += a.plane->kind(floor_to_int(place.x()), floor_to_int(place.y())) != CellKind::kUnknown ? 1 : 0;
    }
  }
  const double cell_b = b.plane->cell_m() * b.plane->cell_m();
  const double cell_a = a.plane->cell_m() * a.plane->cell_m();
  const double smaller = std::min(static_cast<double>(a.plane->known_cells()) * cell_a,
                                  static_cast<double>(b.plane->known_cells()) * cell_b);
  Overlap overlap;
  overlap.area_m2 = static_cast<double>(common) * kOverlapStride * kOverlapStride * cell_b;
  overlap.share = smaller > 0.0 ? std::min(1.0, overlap.area_m2 / smaller) : 0.0;
  return overlap;
}

Agreement measure_agreement(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b) {
  const Judged on_a = judge_elements(b.surface, a, a_from_b);
  const Judged on_b = judge_elements(a.surface, b, inverse(a_from_b));
  Agreement agreement;
  agreement.fitting = share(on_a.fitting + on_b.fitting, on_a.all + on_b.all);
  agreement.contradicted = std::max(share(on_a.contradicted, on_a.all), share(on_b.contradicted, on_b.all));
  return agreement;
}

}  // namespace submapd::internal
