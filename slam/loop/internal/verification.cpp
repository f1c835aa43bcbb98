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

struct Share {
  std::size_t part = 0;
  std::size_t whole = 0;
};

// Whether the cell or one of its eight neighbours is of a kind for which `wanted` holds.
template <typename Wanted>
bool any_around(const CellPlane& plane, const Eigen::Vector2i& cell, Wanted wanted) {
  for (int y = -1; y <= 1; ++y) {
    for (int x = -1; x <= 1; ++x) {
      if (wanted(plane.kind(cell.x() + x, cell.y() + y))) {
        return true;
      }
    }
  }
  return false;
}

bool any_known_around(const CellPlane& plane, const Eigen::Vector2i& cell) {
  return any_around(plane, cell, [](CellKind kind) { return kind != CellKind::kUnknown; });
}

bool any_occupied_around(const CellPlane& plane, const Eigen::Vector2i& cell) {
  return any_around(plane, cell, [](CellKind kind) { return kind == CellKind::kOccupied; });
}

bool all_free_around(const CellPlane& plane, const Eigen::Vector2i& cell) {
  return !any_around(plane, cell, [](CellKind kind) { return kind != CellKind::kFree; });
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

Share fitting(const SurfaceIndex& points, const SubmapView& target, const Pose2& target_from_points) {
  Share share;
  const Eigen::Matrix2d turn = rotation(target_from_points.yaw);
  for (const SurfaceElement& element : points.elements()) {
    const Eigen::Vector2d place = turn * element.mean + target_from_points.translation();
    if (!any_known_around(*target.plane, target.plane->cell_at(place))) {
      continue;
    }
    ++share.whole;
    share.part += fits(target.surface, place, turn * element.normal) ? 1 : 0;
  }
  return share;
}

// Only what stands there to the end counts: people leave surfaces behind where cells are free again, and cells where
// nobody looked again.
double contradicted(const SubmapView& points, const CellPlane& target, const Pose2& target_from_points) {
  Share share;
  const Eigen::Matrix2d turn = rotation(target_from_points.yaw);
  for (const SurfaceElement& element : points.surface.elements()) {
    if (!element.lasting || !any_occupied_around(*points.plane, points.plane->cell_at(element.mean))) continue;
    const Eigen::Vector2i cell = target.cell_at(turn * element.mean + target_from_points.translation());
    if (target.kind(cell.x(), cell.y()) == CellKind::kUnknown) continue;
    ++share.whole;
    share.part += all_free_around(target, cell) ? 1 : 0;
  }
  return share.whole < kMinJudged ? 0.0 : static_cast<double>(share.part) / static_cast<double>(share.whole);
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

double fitting_share(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b) {
  const Share on_a = fitting(b.surface, a, a_from_b);
  const Share on_b = fitting(a.surface, b, inverse(a_from_b));
  const std::size_t whole = on_a.whole + on_b.whole;
  return whole == 0 ? 0.0 : static_cast<double>(on_a.part + on_b.part) / static_cast<double>(whole);
}

double contradiction_share(const SubmapView& a, const SubmapView& b, const Pose2& a_from_b) {
  return std::max(contradicted(b, *a.plane, a_from_b), contradicted(a, *b.plane, inverse(a_from_b)));
}

}  // namespace submapd::internal
