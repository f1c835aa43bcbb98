#include "slam/matching/surface_normals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "slam/base/planar_scatter.hpp"

namespace submapd {
namespace {

constexpr float kShortest_m = 0.08F;  // of a window
constexpr float kLongest_m = 0.15F;
constexpr float kGaps = 3.0F;  // between points, in a window if that is not too short or too long
constexpr std::size_t kMostGaps = 20;
constexpr std::size_t kFewest = 3;            // points
constexpr std::size_t kStride = 3;            // noise makes next points look farther apart than they are
constexpr float kDirectionSigma_rad = 0.25F;  // known less well is unknown
constexpr float kStraight_m2 = 2.5e-5F;       // (5 mm)^2: no corner
constexpr float kGrazing = 0.03F;             // cosine to the ray: less, and which side is the sensor's is noise
constexpr float kNone = std::numeric_limits<float>::max();

constexpr float square(float x) {
  return x * x;
}

}  // namespace

struct SurfaceNormals::Scatter {
  PlanarScatter moments;
  float small;   // eigenvalue: mean square off the line
  float off_m2;  // the same, not made less by few points; kNone if they make no line
};

SurfaceNormals::SurfaceNormals(std::size_t max_points) {
  before_.reserve(max_points + 1);
  begin_.reserve(max_points);
  end_.reserve(max_points);
}

inline SurfaceNormals::Scatter SurfaceNormals::scatter_of(std::size_t first, std::size_t last) const {
  const Sums& a = before_[first];
  const Sums& b = before_[last + 1];
  const auto n = static_cast<float>(last + 1 - first);
  const double inverse = 1.0 / static_cast<double>(n);
  const double mx = (b.x - a.x) * inverse;
  const double my = (b.y - a.y) * inverse;
  Scatter s;
  s.moments = {static_cast<float>((b.xx - a.xx) * inverse - mx * mx),
               static_cast<float>((b.xy - a.xy) * inverse - mx * my),
               static_cast<float>((b.yy - a.yy) * inverse - my * my)};
  const ScatterValues values = eigenvalues(s.moments);
  s.small = std::max(values.small, 1e-6F);
  const float off = s.small * n / std::max(n - 2.0F, 0.5F);
  const bool line = last + 1 >= first + kFewest && off <= square(kDirectionSigma_rad) * n * values.large;
  s.off_m2 = line ? off : kNone;
  return s;
}

void SurfaceNormals::find_runs(std::span<const ScanPoint> points) {
  const std::size_t n = points.size();
  before_.assign(1, {});
  begin_.resize(n);
  end_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto x = static_cast<double>(points[i].x);
    const auto y = static_cast<double>(points[i].y);
    const Sums& s = before_.back();
    before_.push_back({s.x + x, s.y + y, s.xx + x * x, s.xy + x * y, s.yy + y * y});
    const bool goes_on = i > 0 && squared_distance(points[i], points[i - 1]) <= square(kLongest_m);
    begin_[i] = goes_on ? begin_[i - 1] : static_cast<std::uint32_t>(i);
  }
  for (std::size_t i = n; i-- > 0;) {
    end_[i] = i + 1 < n && begin_[i + 1] == begin_[i] ? end_[i + 1] : static_cast<std::uint32_t>(i);
  }
}

void SurfaceNormals::fill(std::span<ScanPoint> points) {
  find_runs(points);
  for (ScanPoint& p : points) p.normal_x = p.normal_y = 0.0F;
  for (std::size_t i = 0; i < points.size(); ++i) {
    ScanPoint& p = points[i];
    const std::size_t begin = begin_[i];
    const std::size_t end = end_[i];
    if (end - begin + 1 < kFewest) continue;
    const std::size_t left = std::min(i - begin, kStride);
    const std::size_t right = std::min(end - i, kStride);
    const float gap_left2 = left > 0 ? squared_distance(p, points[i - left]) / square(static_cast<float>(left)) : kNone;
    const float gap_right2 =
        right > 0 ? squared_distance(p, points[i + right]) / square(static_cast<float>(right)) : kNone;
    const float gap_m = std::sqrt(std::min(gap_left2, gap_right2));
    const float window_m = std::clamp(kGaps * gap_m, kShortest_m, kLongest_m);
    const auto gaps =
        static_cast<std::size_t>(std::min(window_m / std::max(gap_m, 1e-3F), static_cast<float>(kMostGaps)));
    const std::size_t half = (gaps + 1) / 2;
    Scatter s = scatter_of(i - std::min(i - begin, half), i + std::min(end - i, half));
    if (s.off_m2 > kStraight_m2) {
      const Scatter before = scatter_of(i - std::min(i - begin, gaps), i);
      const Scatter behind = scatter_of(i, i + std::min(end - i, gaps));
      if (before.off_m2 < s.off_m2) s = before;
      if (behind.off_m2 < s.off_m2) s = behind;
      if (s.off_m2 == kNone) continue;
    }
    const auto [nx, ny] = normal_of(s.moments, s.small);
    const float facing = nx * p.view_x + ny * p.view_y;
    const float norm = std::sqrt(nx * nx + ny * ny);
    if (std::abs(facing) < kGrazing * norm) continue;
    const float scale = std::copysign(1.0F / norm, facing);
    p.normal_x = scale * nx;
    p.normal_y = scale * ny;
  }
}

}  // namespace submapd
