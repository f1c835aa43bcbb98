#include "slam/matching/scan_points.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr float kVoxel_m = 0.10F;  // surface cell the density weight refers to
constexpr double kMixedPixelJump_m = 0.10;
constexpr float kApart_m = 0.3F;  // neighbouring points farther apart belong to different things
constexpr float kSmall_m = 1.0F;  // across, at most, is who may walk

// Slope of the surface between two neighbouring beams against the ray, from their ranges.
double slope_angle(double range, double neighbour, double step_rad) {
  return std::atan2(neighbour * std::sin(step_rad), std::abs(range - neighbour * std::cos(step_rad)));
}

// No point is so far that std::hypot's care pays for its time.
float apart_m(const ScanPoint& a, const ScanPoint& b) {
  return std::sqrt(squared_distance(a, b));
}

}  // namespace

ScanPoints::ScanPoints(const ScanPointOptions& options, int max_beams)
    : options_(options), max_beams_(static_cast<std::size_t>(max_beams)), normals_(max_beams_) {
  all_.reserve(max_beams_);
  thinned_.reserve(max_beams_);
  beams_.reserve(max_beams_);
  usable_.reserve(max_beams_);
  ranges_scratch_.reserve(max_beams_);
  directions_.reserve(max_beams_);
}

void ScanPoints::update_table(const ScanGeometry& geometry, std::size_t beams) {
  if (directions_.size() == beams && table_geometry_ == geometry) return;
  table_geometry_ = geometry;
  directions_.resize(beams);
  for (std::size_t i = 0; i < beams; ++i) {
    const double angle =
        geometry.first_angle_rad + static_cast<double>(i) * geometry.angle_step_rad + geometry.base_from_sensor.yaw;
    directions_[i] = Eigen::Vector2f(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)));
  }
}

void ScanPoints::assign_beams(const Scan& scan, const Twist2& twist) {
  const std::size_t n = std::min(scan.ranges_mm.size(), max_beams_);
  update_table(scan.geometry, n);
  angle_step_rad_ = std::abs(scan.geometry.angle_step_rad);
  filter(scan, n);
  beams_.assign(n, BeamEnd{});
  unwarp(scan, twist);
}

void ScanPoints::assign(const Scan& scan, const Twist2& twist) {
  assign_beams(scan, twist);
  normals_.fill(all_);
  auto point = all_.begin();
  for (BeamEnd& end : beams_) {
    if (!end.hit || end.range_m <= 0.0F) continue;
    end.normal_x = point->normal_x;
    end.normal_y = point->normal_y;
    ++point;
  }
  describe();
}

void ScanPoints::unwarp_again(const Scan& scan, const Twist2& twist) {
  unwarp(scan, twist);
  describe();
}

void ScanPoints::describe() {
  weigh();
  mark_alone();
  thin();
}

void ScanPoints::filter(const Scan& scan, std::size_t n) {
  const ScanGeometry& g = scan.geometry;
  usable_.assign(n, 0);
  const double min_mm = g.range_min_m * 1e3;
  const double max_mm = std::min(g.range_max_m * 1e3, 65535.0);
  for (std::size_t i = 0; i < n; ++i) {
    const double r = scan.ranges_mm[i];
    usable_[i] = r > kErrorCode_mm && r >= min_mm && r < max_mm ? 1 : 0;
  }
  // Mixed pixels: a veil between foreground and background lies along the ray on both sides.
  for (std::size_t i = 1; i + 1 < n; ++i) {
    if (usable_[i] == 0 || usable_[i - 1] == 0 || usable_[i + 1] == 0) continue;
    const double r = scan.ranges_mm[i] * 1e-3;
    const double before = scan.ranges_mm[i - 1] * 1e-3;
    const double after = scan.ranges_mm[i + 1] * 1e-3;
    const bool monotone = (before < r) == (r < after);
    if (monotone && std::abs(r - before) > kMixedPixelJump_m && std::abs(r - after) > kMixedPixelJump_m &&
        slope_angle(r, before, angle_step_rad_) < options_.mixed_pixel_rad &&
        slope_angle(r, after, angle_step_rad_) < options_.mixed_pixel_rad) {
      usable_[i] = 2;  // free up to there, but no hit
    }
  }
}

void ScanPoints::unwarp(const Scan& scan, const Twist2& twist) {
  const ScanGeometry& g = scan.geometry;
  const std::size_t n = beams_.size();
  all_.clear();
  const double sweep = g.sweep_s;
  const auto sensor_x = static_cast<float>(g.base_from_sensor.x);
  const auto sensor_y = static_cast<float>(g.base_from_sensor.y);
  const double per_beam = n > 1 ? sweep / static_cast<double>(n - 1) : 0.0;
  const Pose2 middle = exp_twist(twist, 0.5 * sweep);
  const Eigen::Vector2d origin = transform(middle, g.base_from_sensor.translation());
  origin_ = origin.cast<float>();

  for (std::size_t i = 0; i < n; ++i) {
    BeamEnd& end = beams_[i];
    const bool code_free = options_.error_code_is_free && scan.ranges_mm[i] == kErrorCode_mm;
    if (usable_[i] == 0 && !code_free) continue;
    const float range = code_free ? static_cast<float>(g.range_max_m) : static_cast<float>(scan.ranges_mm[i]) * 1e-3F;
    const float bx = sensor_x + range * directions_[i].x();
    const float by = sensor_y + range * directions_[i].y();
    // Exp(xi tau) to second order: |omega tau| stays below 0.05 rad for any cart.
    const double tau = per_beam * static_cast<double>(i);
    const auto phi = static_cast<float>(twist.wz * tau);
    const auto tx = static_cast<float>(twist.vx * tau);
    const auto ty = static_cast<float>(twist.vy * tau);
    const float c = 1.0F - 0.5F * phi * phi;
    const float shift_x = tx - 0.5F * phi * ty;
    const float shift_y = ty + 0.5F * phi * tx;
    end.x = c * bx - phi * by + shift_x;
    end.y = phi * bx + c * by + shift_y;
    end.range_m = range;
    end.hit = usable_[i] == 1;
    if (!end.hit) continue;
    ScanPoint point;
    point.x = end.x;
    point.y = end.y;
    point.range_m = range;
    point.view_x = -(c * directions_[i].x() - phi * directions_[i].y());
    point.view_y = -(phi * directions_[i].x() + c * directions_[i].y());
    point.normal_x = end.normal_x;
    point.normal_y = end.normal_y;
    all_.push_back(point);
  }
}

void ScanPoints::weigh() {
  double square_sum = 0.0;
  ranges_scratch_.clear();
  for (const ScanPoint& p : all_) {
    square_sum += static_cast<double>(p.range_m) * static_cast<double>(p.range_m);
    ranges_scratch_.push_back(p.range_m);
  }
  rms_range_m_ = all_.empty() ? 0.0 : std::sqrt(square_sum / static_cast<double>(all_.size()));
  far_range_m_ = 0.0;
  if (!ranges_scratch_.empty()) {
    const auto far = ranges_scratch_.begin() + static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(all_.size() - 1));
    std::nth_element(ranges_scratch_.begin(), far, ranges_scratch_.end());
    far_range_m_ = static_cast<double>(*far);
  }
  // Inverse root of the number of beams that fall on one surface cell, from the spacing to the next point.
  for (std::size_t i = 0; i < all_.size(); ++i) {
    const ScanPoint& next = all_[i + 1 < all_.size() ? i + 1 : i - (i > 0 ? 1 : 0)];
    const float spacing = apart_m(next, all_[i]);
    all_[i].weight = std::sqrt(std::clamp(spacing / kVoxel_m, 0.02F, 1.0F));
  }
}

void ScanPoints::mark_alone() {
  std::size_t first = 0;
  for (std::size_t i = 0; i + 1 < all_.size(); ++i) {
    const ScanPoint& p = all_[i];
    const ScanPoint& next = all_[i + 1];
    if (apart_m(next, p) < kApart_m) continue;
    const ScanPoint& begin = all_[first];
    const bool in_front =
        first > 0 && all_[first - 1].range_m > begin.range_m + kApart_m && next.range_m > p.range_m + kApart_m;
    if (in_front && apart_m(p, begin) < kSmall_m) {
      for (std::size_t k = first; k <= i; ++k) all_[k].alone = true;
    }
    first = i + 1;
  }
}

void ScanPoints::thin() {
  thinned_.clear();
  if (all_.empty()) return;
  // Length of the seen contour without its jumps decides the spacing that leaves about thin_to points.
  float length = 0.0F;
  for (std::size_t i = 1; i < all_.size(); ++i) {
    length += std::min(apart_m(all_[i], all_[i - 1]), 0.3F);
  }
  const float spacing =
      std::max(static_cast<float>(options_.min_spacing_m), length / static_cast<float>(options_.thin_to));
  thinned_.push_back(all_.front());
  for (const ScanPoint& p : all_) {
    const ScanPoint& last = thinned_.back();
    if (apart_m(p, last) >= spacing) thinned_.push_back(p);
  }
  // Wide jumps count as 0.3 m above but keep both their points: a scan of many may need a second thinning, by number.
  const auto limit = static_cast<std::size_t>(options_.thin_to);
  if (const std::size_t n = thinned_.size(); n > limit) {
    for (std::size_t i = 0; i < limit; ++i) thinned_[i] = thinned_[i * n / limit];
    thinned_.resize(limit);
  }
}

}  // namespace submapd
