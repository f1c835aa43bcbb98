#include "slam/loop/internal/search_points.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_set>

#include "slam/base/floor_to_int.hpp"
#include "slam/loop/internal/match_grid.hpp"
#include "slam/loop/internal/placement_search.hpp"
#include "slam/loop/submap_outline.hpp"

namespace submapd::internal {
namespace {

constexpr double kThinning_m = 0.10;
constexpr double kCoarserThinning = 1.3;  // and again, until the points are few enough
constexpr std::size_t kMaxPoints = 400;
constexpr double kOuterShare = 0.95;
constexpr int kBins = 360;
constexpr int kMaxPeaks = 8;
constexpr int kPeakApart = 5;  // bins
constexpr double kAroundPeak_rad = 3.0 * std::numbers::pi / 180.0;
constexpr double kRadPerBin = std::numbers::pi / 180.0;

using Histogram = std::array<double, kBins>;

// Normals scatter by a few degrees; without smoothing the correlation would miss neighbouring bins.
Histogram smoothed(const std::array<float, kBins>& raw) {
  constexpr std::array<double, 5> kWeights{1.0, 2.0, 3.0, 2.0, 1.0};
  Histogram out{};
  for (int i = 0; i < kBins; ++i) {
    for (int k = 0; k < 5; ++k) {
      out[static_cast<std::size_t>(i)] +=
          kWeights[static_cast<std::size_t>(k)] *
          static_cast<double>(raw[static_cast<std::size_t>((i + k - 2 + kBins) % kBins)]);
    }
  }
  return out;
}

// Value k: how well b's normals fit a's when b is turned by k bins.
Histogram correlation(const Histogram& a, const Histogram& b) {
  Histogram out{};
  for (std::size_t turn = 0; turn < kBins; ++turn) {
    for (std::size_t i = 0; i < kBins; ++i) {
      out[turn] += a[(i + turn) % kBins] * b[i];
    }
  }
  return out;
}

}  // namespace

std::vector<Eigen::Vector2d> thinned_points(const SurfaceIndex& surface) {
  std::vector<Eigen::Vector2d> points;
  for (double side_m = kThinning_m;; side_m *= kCoarserThinning) {
    std::unordered_set<std::uint64_t> taken;
    points.clear();
    for (const SurfaceElement& element : surface.elements()) {
      const int x = floor_to_int(element.mean.x() / side_m);
      const int y = floor_to_int(element.mean.y() / side_m);
      const auto cell =
          static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32U | static_cast<std::uint32_t>(y);
      if (taken.insert(cell).second) {
        points.push_back(element.mean);
      }
    }
    if (points.size() <= kMaxPoints) {
      return points;
    }
  }
}

double outer_radius_m(const std::vector<Eigen::Vector2d>& points) {
  std::vector<double> radii;
  radii.reserve(points.size());
  for (const Eigen::Vector2d& point : points) {
    radii.push_back(point.norm());
  }
  const auto rank = static_cast<std::ptrdiff_t>(kOuterShare * static_cast<double>(radii.size() - 1));
  std::nth_element(radii.begin(), radii.begin() + rank, radii.end());
  return radii[static_cast<std::size_t>(rank)];
}

std::vector<double> angles_by_normals(const FinishedSubmap& a, const FinishedSubmap& b, double low_rad, double high_rad,
                                      double cell_m, double radius_m) {
  std::vector<double> angles = angle_steps(low_rad, high_rad, cell_m, radius_m);
  const Histogram fit =
      correlation(smoothed(make_outline(a).normal_histogram), smoothed(make_outline(b).normal_histogram));
  std::vector<int> bins(kBins);
  for (int i = 0; i < kBins; ++i) {
    bins[static_cast<std::size_t>(i)] = i;
  }
  std::stable_sort(bins.begin(), bins.end(),
                   [&](int l, int r) { return fit[static_cast<std::size_t>(l)] > fit[static_cast<std::size_t>(r)]; });
  if (!(fit[static_cast<std::size_t>(bins.front())] > 0.0)) {
    return angles;
  }
  std::vector<double> peaks;
  for (const int bin : bins) {
    const double turn = bin * kRadPerBin;
    const bool inside = std::abs(wrap_angle(turn - 0.5 * (low_rad + high_rad))) <= 0.5 * (high_rad - low_rad);
    const bool apart = std::all_of(peaks.begin(), peaks.end(), [&](double peak) {
      return std::abs(wrap_angle(turn - peak)) >= kPeakApart * kRadPerBin;
    });
    if (inside && apart) {
      peaks.push_back(turn);
    }
    if (peaks.size() == kMaxPeaks) {
      break;
    }
  }
  std::erase_if(angles, [&](double angle) {
    return std::none_of(peaks.begin(), peaks.end(),
                        [&](double peak) { return std::abs(wrap_angle(angle - peak)) <= kAroundPeak_rad; });
  });
  return angles;
}

int levels_for(double half_window_m, double cell_m) {
  int levels = 1;
  while (levels <= kMaxPyramidLevel && (1 << levels) * cell_m <= half_window_m) {
    ++levels;
  }
  return levels;
}

}  // namespace submapd::internal
