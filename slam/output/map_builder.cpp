#include "slam/output/map_builder.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace submapd {
namespace {

constexpr double kMargin_m = 0.5;
constexpr std::uint8_t kCountLimit = 240;

Scan scan_of(const Keyframe& keyframe) {
  Scan scan;
  scan.stamp_us = keyframe.stamp_us;
  scan.index = keyframe.scan_index;
  scan.geometry = keyframe.geometry;
  scan.ranges_mm = keyframe.ranges_mm;
  return scan;
}

void count_up(std::uint8_t& one, std::uint8_t& other) {
  if (++one < kCountLimit) return;
  one = static_cast<std::uint8_t>(one / 2);
  other = static_cast<std::uint8_t>(other / 2);
}

// The same for misses of a row of cells, but for those that bear the mark; without branches, so that it vectorises.
void count_misses(std::size_t cells, const std::uint8_t* marks, std::uint8_t mark, std::uint8_t* misses,
                  std::uint8_t* hits) {
  for (std::size_t i = 0; i < cells; ++i) {
    const auto counted = static_cast<std::uint8_t>(misses[i] + (marks[i] != mark ? 1 : 0));
    const bool full = counted >= kCountLimit;
    misses[i] = static_cast<std::uint8_t>(full ? counted / 2 : counted);
    hits[i] = static_cast<std::uint8_t>(full ? hits[i] / 2 : hits[i]);
  }
}

}  // namespace

MapBuilder::MapBuilder(double cell_m, std::size_t bytes_limit, const OccupancyOptions& occupancy, int max_beams)
    : cell_m_(cell_m),
      bytes_limit_(bytes_limit),
      occupancy_(occupancy),
      points_(ScanPointOptions{}, max_beams),
      low_(Eigen::Vector2d::Constant(std::numeric_limits<double>::max())),
      high_(Eigen::Vector2d::Constant(std::numeric_limits<double>::lowest())),
      free_space_(FreeSpaceOptions{}, cell_m, max_beams),
      max_beams_(static_cast<std::size_t>(max_beams)) {
  placed_.reserve(max_beams_);
}

// Beams in the map's axes about a cell corner near the sensor: float coordinates stay small anywhere on a site.
void MapBuilder::place(const Keyframe& keyframe, const Pose2& map_from_base) {
  points_.assign_beams(scan_of(keyframe), keyframe.twist);
  corner_ = {std::floor(map_from_base.x / cell_m_) * cell_m_, std::floor(map_from_base.y / cell_m_) * cell_m_};
  const Pose2 about_corner{map_from_base.x - corner_.x(), map_from_base.y - corner_.y(), map_from_base.yaw};
  origin_ = place_beams(about_corner, points_.beams(), points_.origin(), placed_);
}

void MapBuilder::extend(const Keyframe& keyframe, const Pose2& map_from_base) {
  place(keyframe, map_from_base);
  low_ = low_.cwiseMin(map_from_base.translation());
  high_ = high_.cwiseMax(map_from_base.translation());
  for (const BeamEnd& b : placed_) {
    if (b.range_m <= 0.0F) continue;
    const Eigen::Vector2d p = corner_ + Eigen::Vector2d(static_cast<double>(b.x), static_cast<double>(b.y));
    low_ = low_.cwiseMin(p);
    high_ = high_.cwiseMax(p);
  }
}

void MapBuilder::begin() {
  if (low_.x() > high_.x()) low_ = high_ = Eigen::Vector2d::Zero();
  for (;;) {
    low_ = ((low_.array() - kMargin_m) / cell_m_).floor() * cell_m_;
    const Eigen::Vector2d size = (high_.array() + kMargin_m - low_.array()) / cell_m_;
    const double cells = std::ceil(size.x()) * std::ceil(size.y());
    if (3.0 * cells <= static_cast<double>(bytes_limit_)) {
      width_ = static_cast<int>(std::ceil(size.x()));
      height_ = static_cast<int>(std::ceil(size.y()));
      break;
    }
    cell_m_ *= 2.0;
    free_space_ = FreeSpacePolygon(FreeSpaceOptions{}, cell_m_, static_cast<int>(max_beams_));
  }
  const auto cells = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  hits_.assign(cells, 0);
  misses_.assign(cells, 0);
  marks_.assign(cells, 0);
}

void MapBuilder::insert(const Keyframe& keyframe, const Pose2& map_from_base) {
  place(keyframe, map_from_base);
  ++scan_mark_;
  if (scan_mark_ == 0) {
    std::fill(marks_.begin(), marks_.end(), std::uint8_t{0});
    scan_mark_ = 1;
  }
  // Cell of the corner: the spans below are about it.
  const int cx = static_cast<int>(std::lround((corner_.x() - low_.x()) / cell_m_));
  const int cy = static_cast<int>(std::lround((corner_.y() - low_.y()) / cell_m_));
  const auto at = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  };
  for (const BeamEnd& b : placed_) {
    if (!b.hit || b.range_m <= 0.0F) continue;
    const CellIndex cell = cell_at(static_cast<double>(b.x), static_cast<double>(b.y), 1.0 / cell_m_);
    const int x = cell.ix - kMapBias + cx;
    const int y = cell.iy - kMapBias + cy;
    if (x < 0 || y < 0 || x >= width_ || y >= height_) continue;
    const std::size_t i = at(x, y);
    if (marks_[i] == scan_mark_) continue;
    marks_[i] = scan_mark_;
    count_up(hits_[i], misses_[i]);
  }
  for (const RowSpan& span : free_space_.convert(origin_.x(), origin_.y(), placed_)) {
    const int y = span.iy - kMapBias + cy;
    if (y < 0 || y >= height_) continue;
    const int begin = std::max(span.ix_begin - kMapBias + cx, 0);
    const int end = std::min(span.ix_end - kMapBias + cx, width_);
    if (begin >= end) continue;
    const std::size_t first = at(begin, y);
    count_misses(static_cast<std::size_t>(end - begin), &marks_[first], scan_mark_, &misses_[first], &hits_[first]);
  }
}

MapImage MapBuilder::image() const {
  MapImage out;
  out.cell_m = cell_m_;
  out.origin_x_m = low_.x();
  out.origin_y_m = low_.y();
  out.width = width_;
  out.height = height_;
  out.cells.assign(hits_.size(), 0);
  for (std::size_t i = 0; i < hits_.size(); ++i) {
    if (hits_[i] == 0 && misses_[i] == 0) continue;
    out.cells[i] = cell_of(occupancy_probability(hits_[i], misses_[i], occupancy_));
  }
  return out;
}

}  // namespace submapd
