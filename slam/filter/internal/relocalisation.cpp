#include "slam/filter/internal/relocalisation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace submapd {
namespace {

constexpr double kSpeed_m_s = 3.0;
constexpr double kTurn_rad_s = 2.0;
constexpr double kLeast_m = 0.5;
constexpr double kLeast_rad = 0.35;
constexpr double kMost_m = 10.0;
constexpr double kNear_m = 1.0;  // it is looked for here first
constexpr double kFar_m = 3.0;   // sets the step of angles: 5 cm at this distance, which the descent then refines
constexpr double kSector_rad = 0.35;
constexpr int kNodes = 200'000;
// Few, for a quick answer over 20 m x 20 m x 360 deg: all points judge what is found. The mapper works on no scan
// meanwhile, and on one processor nobody else works at all.
constexpr int kExpansions = 4'000;
constexpr int kPoints = 40;
// Of a place worth a match: true ones have 0.7 and more, where a scan fits nowhere the best has 0.5. The two shares
// below ask for some 0.35 and judge by all points.
constexpr double kLeastScore = 0.4;
constexpr double kKnown = 0.5;    // share of the scan that must lie on known ground ...
constexpr double kMatched = 0.7;  // ... and of that, what must fit
constexpr double kWeak_m = 0.5;
constexpr double kWeak_rad = 0.2;

struct Place {
  Pose2 pose;
  double score = 0.0;
};

MotionPrior weak_prior(const Pose2& pose) {
  MotionPrior prior;
  prior.pose = pose;
  prior.information =
      Eigen::Vector3d(1.0 / (kWeak_m * kWeak_m), 1.0 / (kWeak_m * kWeak_m), 1.0 / (kWeak_rad * kWeak_rad)).asDiagonal();
  return prior;
}

bool apart(const Pose2& a, const Pose2& b, const CorrelativeOptions& options) {
  const Pose2 d = between(a, b);
  return std::hypot(d.x, d.y) > options.peak_distance_m ||
         std::abs(wrap_angle(d.yaw)) > 2.0 * options.peak_distance_rad;
}

}  // namespace

std::optional<MatchResult> relocalise(const ScanRegistration& scan, const MapperOptions& options, const MapView& view,
                                      const Pose2& last, double gap_s) {
  if (scan.blind()) return std::nullopt;
  CorrelativeOptions wide = options.search;
  wide.max_nodes = kNodes;
  wide.max_expansions = kExpansions;
  wide.max_points = kPoints;
  wide.second_share = options.ambiguous_ratio;
  CorrelativeSearch search(wide);
  std::vector<Place> places;
  SearchWindow window;
  window.least_score = kLeastScore;
  const auto look = [&](double yaw_rad) {
    const CorrelativeResult found = search.search(scan.points().thinned(), kFar_m, view.field, options.map.cell_m,
                                                  {last.x, last.y, yaw_rad}, window);
    if (found.score <= 0.0) return;
    places.push_back({found.pose, found.score});
    if (found.second_score > 0.0) places.push_back({found.second_pose, found.second_score});
    window.least_score = std::max(window.least_score, options.ambiguous_ratio * found.score);
  };
  // What is found near makes the rest quick: that must only be looked at for places about as good.
  window.half_x_m = window.half_y_m = kNear_m;
  window.half_yaw_rad = kSector_rad;
  look(last.yaw);
  window.half_x_m = window.half_y_m = std::min(kLeast_m + kSpeed_m_s * std::max(gap_s, 0.0), kMost_m);
  const double turn_rad = std::min(kLeast_rad + kTurn_rad_s * std::max(gap_s, 0.0), std::numbers::pi);
  const int sectors = std::max(static_cast<int>(std::ceil(turn_rad / kSector_rad)), 1);
  window.half_yaw_rad = turn_rad / sectors;
  for (int i = 0; i < sectors; ++i) look(last.yaw - turn_rad + (2 * i + 1) * window.half_yaw_rad);
  if (places.empty()) return std::nullopt;
  const Place best =
      *std::max_element(places.begin(), places.end(), [](const Place& a, const Place& b) { return a.score < b.score; });
  const MatchResult match = scan.match(view, best.pose, weak_prior(best.pose));
  const KnownFit fit = scan.fit(view, match.pose);
  if (fit.known_ratio < kKnown || fit.matched_ratio < kMatched) return std::nullopt;
  for (const Place& other : places) {
    if (other.score <= options.ambiguous_ratio * best.score || !apart(best.pose, other.pose, wide)) continue;
    // Two hills of one mountain lead to the same top.
    const MatchResult there = scan.match(view, other.pose, weak_prior(other.pose));
    if (apart(match.pose, there.pose, wide) &&
        scan.fit(view, there.pose).matched_ratio > options.ambiguous_ratio * fit.matched_ratio) {
      return std::nullopt;
    }
  }
  return match;
}

}  // namespace submapd
