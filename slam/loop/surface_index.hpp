// The usable surface points of a sub-map, with look-up of the closest one that can be the same piece of surface.
//
// Built per use; immutable afterwards.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "slam/loop/cell_plane.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// A surface point in the form the estimators use. Sub-map frame.
struct SurfaceElement {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();    // m; of a line-like one pooled across the line
  Eigen::Vector2d normal = Eigen::Vector2d::Zero();  // unit, or zero if not line-like
  double variance_m2 = 0.0;                          // of the mean (across the line)
  std::uint32_t source = 0;                          // index into FinishedSubmap::surface
  // Stands to the end, and hit by three key-frames (all, if those are too few): nobody who walked by.
  bool lasting = true;
  [[nodiscard]] bool line_like() const { return !normal.isZero(0.0); }
};

class SurfaceIndex {
 public:
  static constexpr std::int32_t kNone = -1;

  // Takes points of at least two hits, or all where those are too few to stand for the sub-map (few, sparse scans).
  // What stands to the end its plane tells, if it has one.
  SurfaceIndex(const FinishedSubmap& submap, const std::optional<CellPlane>& plane);

  [[nodiscard]] const std::vector<SurfaceElement>& elements() const { return elements_; }
  [[nodiscard]] std::size_t bytes() const {
    return elements_.capacity() * sizeof(SurfaceElement) + first_.capacity() * sizeof(std::int32_t);
  }

  // Index of the element closest to `point` within radius_m, or kNone. If both `normal` and the element's are set they
  // must agree within acos(min_cosine): thin walls seen from both sides are two surfaces.
  [[nodiscard]] std::int32_t closest(const Eigen::Vector2d& point, const Eigen::Vector2d& normal, double radius_m,
                                     double min_cosine) const;

  // Appends the elements within radius_m of `point` to `found`, in a fixed order.
  void within(const Eigen::Vector2d& point, double radius_m, std::vector<std::int32_t>& found) const;

 private:
  void build_buckets();
  void pool_lines();
  // Columns and rows, both ends included.
  struct BucketRange {
    int column_first;
    int column_last;
    int row_first;
    int row_last;
  };
  [[nodiscard]] BucketRange buckets_near(const Eigen::Vector2d& point, double radius_m) const;
  // REQUIRES: 0 <= row < rows_. The next row follows.
  [[nodiscard]] const std::int32_t* first_of(int row) const {
    return &first_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_)];
  }
  template <typename Visit>
  void visit_near(const Eigen::Vector2d& point, double radius_m, const Visit& visit) const;

  std::vector<SurfaceElement> elements_;  // sorted by bucket
  double bucket_m_ = 0.2;
  double buckets_per_m_ = 5.0;
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  int columns_ = 0;
  int rows_ = 0;
  std::vector<std::int32_t> first_;  // of each bucket, and one past the last
};

}  // namespace submapd
