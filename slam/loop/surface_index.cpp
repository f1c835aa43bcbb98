#include "slam/loop/surface_index.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr std::uint16_t kMinHits = 2;
constexpr double kMaxBuckets = 1 << 20;
constexpr double kPoolRadius_m = 0.16;  // a 10 cm cell and its neighbours
constexpr double kPoolCosine = 0.94;    // 20 deg
constexpr double kPoolAcross_m = 0.08;
constexpr double kMeanSigma_m = 0.01;  // of a surface mean however many hits it has: cell effects, drift inside the map
constexpr std::uint16_t kLastingKeyframes = 3;
constexpr double kThin_m = 0.05;  // spread of a wall or a pole at most; of the trail of somebody who walks it is more

// What a point must count to be one of many: `wanted`, unless most of the sub-map counts less (few, sparse scans).
std::uint16_t bound_for(const std::vector<SurfacePoint>& surface, std::uint16_t SurfacePoint::*counted,
                        std::uint16_t wanted, std::uint16_t otherwise) {
  const auto enough = std::count_if(surface.begin(), surface.end(),
                                    [=](const SurfacePoint& point) { return point.*counted >= wanted; });
  return 2 * static_cast<std::size_t>(enough) >= surface.size() ? wanted : otherwise;
}

bool any_occupied_around(const CellPlane& plane, const Eigen::Vector2d& place) {
  return plane.any_around(plane.cell_at(place), [](CellKind kind) { return kind == CellKind::kOccupied; });
}

}  // namespace

SurfaceIndex::SurfaceIndex(const FinishedSubmap& submap, const std::optional<CellPlane>& plane) {
  const auto& surface = submap.surface;
  const std::uint16_t min_hits = bound_for(surface, &SurfacePoint::hits, kMinHits, 1);
  const std::uint16_t min_keyframes = bound_for(surface, &SurfacePoint::keyframes, kLastingKeyframes, 0);
  elements_.reserve(surface.size());
  for (std::size_t i = 0; i < surface.size(); ++i) {
    const SurfacePoint& p = surface[i];
    if (p.hits < min_hits || !std::isfinite(p.x) || !std::isfinite(p.y)) {
      continue;
    }
    SurfaceElement element;
    element.mean = {p.x, p.y};
    element.normal = {p.normal_x, p.normal_y};
    const double spread = p.sigma_m;
    element.variance_m2 = kMeanSigma_m * kMeanSigma_m + spread * spread / static_cast<double>(p.hits);
    element.source = static_cast<std::uint32_t>(i);
    element.lasting =
        p.keyframes >= min_keyframes && p.sigma_m <= kThin_m && (!plane || any_occupied_around(*plane, element.mean));
    elements_.push_back(element);
  }
  build_buckets();
  pool_lines();
  build_buckets();  // pooling moves means across borders
}

void SurfaceIndex::build_buckets() {
  if (elements_.empty()) {
    return;
  }
  Eigen::Vector2d low = elements_.front().mean;
  Eigen::Vector2d high = low;
  for (const SurfaceElement& element : elements_) {
    low = low.cwiseMin(element.mean);
    high = high.cwiseMax(element.mean);
  }
  origin_ = low;
  const Eigen::Vector2d extent = high - low;
  while ((extent.x() / bucket_m_ + 1.0) * (extent.y() / bucket_m_ + 1.0) > kMaxBuckets) {
    bucket_m_ *= 2.0;
  }
  buckets_per_m_ = 1.0 / bucket_m_;
  columns_ = static_cast<int>(extent.x() * buckets_per_m_) + 1;
  rows_ = static_cast<int>(extent.y() * buckets_per_m_) + 1;

  const auto bucket_of = [this](const SurfaceElement& element) {
    const int column = std::min(columns_ - 1, static_cast<int>((element.mean.x() - origin_.x()) * buckets_per_m_));
    const int row = std::min(rows_ - 1, static_cast<int>((element.mean.y() - origin_.y()) * buckets_per_m_));
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
  };
  first_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
  for (const SurfaceElement& element : elements_) {
    ++first_[bucket_of(element) + 1];
  }
  for (std::size_t i = 1; i < first_.size(); ++i) {
    first_[i] += first_[i - 1];
  }
  std::vector<std::int32_t> next(first_.begin(), first_.end() - 1);
  std::vector<SurfaceElement> sorted(elements_.size());
  for (const SurfaceElement& element : elements_) {
    sorted[static_cast<std::size_t>(next[bucket_of(element)]++)] = element;
  }
  elements_ = std::move(sorted);
}

// A wall along a cell border splits its hits between two cells whose means are pulled apart by truncation; the mean of
// the neighbourhood is not (design notes 5.2). Moves each line-like mean along its normal onto its neighbours' line.
void SurfaceIndex::pool_lines() {
  std::vector<double> shift(elements_.size(), 0.0);
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    const SurfaceElement& centre = elements_[i];
    if (!centre.line_like()) {
      continue;
    }
    double weights = 0.0;
    double sum = 0.0;
    visit_near(centre.mean, kPoolRadius_m, [&](std::int32_t j, double) {
      const SurfaceElement& other = elements_[static_cast<std::size_t>(j)];
      const double across = centre.normal.dot(other.mean - centre.mean);
      if (other.normal.dot(centre.normal) < kPoolCosine || std::abs(across) > kPoolAcross_m) {
        return;
      }
      const double weight = 1.0 / other.variance_m2;
      weights += weight;
      sum += weight * across;
    });
    shift[i] = weights > 0.0 ? sum / weights : 0.0;
  }
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    elements_[i].mean += shift[i] * elements_[i].normal;
  }
}

// The buckets that a circle reaches; none if columns or rows are empty.
SurfaceIndex::BucketRange SurfaceIndex::buckets_near(const Eigen::Vector2d& point, double radius_m) const {
  const Eigen::Vector2d local = point - origin_;
  // One bucket beyond either side stands for all that is farther out.
  const auto bucket = [this](double coordinate_m, int count) {
    const double place = coordinate_m * buckets_per_m_ + 1.0;
    return (place > 0.0 ? static_cast<int>(std::min(place, count + 1.0)) : 0) - 1;
  };
  return {std::max(0, bucket(local.x() - radius_m, columns_)),
          std::min(columns_ - 1, bucket(local.x() + radius_m, columns_)),
          std::max(0, bucket(local.y() - radius_m, rows_)), std::min(rows_ - 1, bucket(local.y() + radius_m, rows_))};
}

template <typename Visit>
void SurfaceIndex::visit_near(const Eigen::Vector2d& point, double radius_m, const Visit& visit) const {
  const BucketRange range = buckets_near(point, radius_m);
  if (range.column_first > range.column_last) return;
  for (int row = range.row_first; row <= range.row_last; ++row) {
    const std::int32_t* first = first_of(row);
    for (std::int32_t i = first[range.column_first]; i < first[range.column_last + 1]; ++i) {
      const double distance2 = (elements_[static_cast<std::size_t>(i)].mean - point).squaredNorm();
      if (distance2 <= radius_m * radius_m) {
        visit(i, distance2);
      }
    }
  }
}

// From the point's own row outwards, until a row is farther than what has been found.
std::int32_t SurfaceIndex::closest(const Eigen::Vector2d& point, const Eigen::Vector2d& normal, double radius_m,
                                   double min_cosine) const {
  const BucketRange range = buckets_near(point, radius_m);
  if (range.column_first > range.column_last) return kNone;
  std::int32_t best = kNone;
  double best_distance2 = radius_m * radius_m;
  const bool has_normal = !normal.isZero(0.0);
  const auto search_row = [&](int row) {
    const std::int32_t* first = first_of(row);
    const std::int32_t end = first[range.column_last + 1];
    for (std::int32_t i = first[range.column_first]; i < end; ++i) {
      const SurfaceElement& element = elements_[static_cast<std::size_t>(i)];
      const double distance2 = (element.mean - point).squaredNorm();
      if (distance2 >= best_distance2) continue;
      if (has_normal && element.line_like() && element.normal.dot(normal) < min_cosine) continue;
      best = i;
      best_distance2 = distance2;
    }
  };
  const double y = point.y() - origin_.y();
  const int middle = std::clamp(static_cast<int>(std::clamp(y * buckets_per_m_, 0.0, static_cast<double>(rows_))),
                                range.row_first, range.row_last + 1);
  for (int row = middle; row <= range.row_last; ++row) {
    const double below = row * bucket_m_ - y;
    if (below > 0.0 && below * below >= best_distance2) break;
    search_row(row);
  }
  for (int row = middle - 1; row >= range.row_first; --row) {
    const double above = y - (row + 1) * bucket_m_;
    if (above > 0.0 && above * above >= best_distance2) break;
    search_row(row);
  }
  return best;
}

void SurfaceIndex::within(const Eigen::Vector2d& point, double radius_m, std::vector<std::int32_t>& found) const {
  visit_near(point, radius_m, [&](std::int32_t i, double) { found.push_back(i); });
}

}  // namespace submapd
