#include "slam/matching/surface_normals.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr float kSpacings = 6.0F;     // a window is as long as so many gaps between points ...
constexpr float kShortest_m = 0.06F;  // ... but not shorter
constexpr float kLongest_m = 0.15F;   // ... nor longer
constexpr std::size_t kFewest = 3;
constexpr float kDirectionSigma_rad = 0.25F;  // less well known is unknown
constexpr float kGrazing = 0.03F;             // cosine to the ray: which side is the sensor's is noise

}  // namespace

SurfaceNormals::SurfaceNormals(std::size_t max_points) {
  before_.reserve(max_points + 1);
}

SurfaceNormals::Line SurfaceNormals::line_through(std::size_t first, std::size_t last) const {
  Line line;
  const std::size_t count = last + 1 - first;
  if (count < kFewest) return line;
  const Sums& a = before_[first];
  const Sums& b = before_[last + 1];
  const double n = static_cast<double>(count);
  const double mx = (b.x - a.x) / n;
  const double my = (b.y - a.y) / n;
  const auto cxx = static_cast<float>((b.xx - a.xx) / n - mx * mx);
  const auto cxy = static_cast<float>((b.xy - a.xy) / n - mx * my);
  const auto cyy = static_cast<float>((b.yy - a.yy) / n - my * my);
  const float mean = 0.5F * (cxx + cyy);
  const float half = 0.5F * (cxx - cyy);
  const float root = std::sqrt(half * half + cxy * cxy);
  const float large = mean + root;
  const float small = std::max(mean - root, 1e-6F) * static_cast<float>(count) / static_cast<float>(count - 2);
  if (small > kDirectionSigma_rad * kDirectionSigma_rad * static_cast<float>(count) * large) return line;
  // The scatter times this is its smaller eigenvalue times this.
  line.small_m2 = small;
  float nx = half > 0.0F ? -cxy : cyy - (mean - root);
  float ny = half > 0.0F ? cxx - (mean - root) : -cxy;
  const float norm = std::sqrt(nx * nx + ny * ny);
  if (norm < 1e-12F) return line;
  line.normal_x = nx / norm;
  line.normal_y = ny / norm;
  line.known = true;
  return line;
}

void SurfaceNormals::fill(std::span<ScanPoint> points) {
  before_.clear();
  before_.push_back({});
  for (const ScanPoint& p : points) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    const Sums& s = before_.back();
    before_.push_back({s.x + x, s.y + y, s.xx + x * x, s.xy + x * y, s.yy + y * y});
  }
  const auto apart2 = [&](std::size_t i, std::size_t k) {
    const float dx = points[i].x - points[k].x;
    const float dy = points[i].y - points[k].y;
    return dx * dx + dy * dy;
  };
  const std::size_t n = points.size();
  for (std::size_t i = 0; i < n; ++i) {
    ScanPoint& p = points[i];
    p.normal_x = p.normal_y = 0.0F;
    const std::size_t left = i > 0 ? i - 1 : i;
    const std::size_t right = i + 1 < n ? i + 1 : i;
    const float spacing2 = left == i ? apart2(i, right) : right == i ? apart2(i, left) : std::min(apart2(i, left), apart2(i, right));
    const float window = std::clamp(kSpacings * std::sqrt(spacing2), kShortest_m, kLongest_m);
    const float whole2 = window * window;
    const float half2 = 0.25F * whole2;
    std::size_t first = i;
    while (first > 0 && apart2(i, first - 1) <= half2) --first;
    const std::size_t half_first = first;
    while (first > 0 && apart2(i, first - 1) <= whole2) --first;
    std::size_t last = i;
    while (last + 1 < n && apart2(i, last + 1) <= half2) ++last;
    const std::size_t half_last = last;
    while (last + 1 < n && apart2(i, last + 1) <= whole2) ++last;
    Line best;
    for (const Line& line : {line_through(half_first, half_last), line_through(first, i), line_through(i, last)}) {
      if (line.known && (!best.known || line.small_m2 < best.small_m2)) best = line;
    }
    if (!best.known) continue;
    const float facing = best.normal_x * p.view_x + best.normal_y * p.view_y;
    if (std::abs(facing) < kGrazing) continue;
    p.normal_x = std::copysign(best.normal_x, best.normal_x * facing);
    p.normal_y = std::copysign(best.normal_y, best.normal_y * facing);
  }
}

}  // namespace submapd
