#include "slam/filter/internal/scan_registration.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr double kMinKnownRatio = 0.10;  // less of the scan on known ground: new territory
constexpr std::size_t kMinPoints = 10;
constexpr double kGoodMatch = 0.55;        // share of the points on known ground that must fit
constexpr double kMinWindow_m = 0.3;       // the search looks at least this far ...
constexpr double kMinWindow_rad = 0.1745;  // ... and 10 deg
constexpr double kMaxWindow_m = 1.2;
constexpr double kMaxWindow_rad = 1.2217;  // 70 deg
constexpr double kWindowSigmas = 2.5;
constexpr double kSecondPlaceLoss = 3.0;  // log posterior: less likely by more than this is no hypothesis
constexpr double kSearchedPrior_m = 0.5;  // after a search the prediction says little more
constexpr double kSearchedPrior_rad = 0.5;
constexpr double kSamePeak_m = 0.10;  // two descents that end closer than this found the same place
constexpr double kSamePeak_rad = 0.0349;

}  // namespace

ScanRegistration::ScanRegistration(const MapperOptions& options)
    : options_(options),
      points_(options.points, options.max_beams),
      search_(options.search),
      likelihood_(options.likelihood, options.map.cell_m),
      matcher_(options.matcher) {}

bool ScanRegistration::blind() const {
  return points_.thinned().size() < kMinPoints;
}

bool ScanRegistration::acceptable(const KnownFit& fit, double good) const {
  return !blind() && (fit.known_ratio < kMinKnownRatio || fit.matched_ratio >= std::max(good, kGoodMatch));
}

MatchResult ScanRegistration::match(const MapView& view, const Pose2& start, const MotionPrior& prior) const {
  return match_scan(points_, view.field, view.map, start, prior, matcher_);
}

KnownFit ScanRegistration::fit(const MapView& view, const Pose2& pose) const {
  return known_fit(points_, view.field, view.map, pose);
}

double ScanRegistration::log_likelihood(const MapView& view, const Pose2& pose) const {
  return evidence_ * likelihood_.log_likelihood(points_.thinned(), view.field, options_.map.cell_m, pose);
}

double ScanRegistration::log_posterior(const MapView& view, const Pose2& pose, const MotionPrior& prior) const {
  const Eigen::Vector3d off(pose.x - prior.pose.x, pose.y - prior.pose.y, wrap_angle(pose.yaw - prior.pose.yaw));
  return log_likelihood(view, pose) - 0.5 * off.dot(prior.information * off);
}

CorrelativeResult ScanRegistration::search_about(const MapView& view, Particle& p, const Eigen::Vector3d& sigma,
                                                 double widen, double good) {
  SearchWindow window;
  window.half_x_m = std::clamp(kWindowSigmas * sigma(0) * widen, kMinWindow_m, kMaxWindow_m * widen);
  window.half_y_m = window.half_x_m;
  window.half_yaw_rad = std::clamp(kWindowSigmas * sigma(2) * widen, kMinWindow_rad, kMaxWindow_rad * widen);
  const CorrelativeResult found =
      search_.search(points_.thinned(), points_.far_range_m(), view.field, options_.map.cell_m, p.prior.pose, window);
  const MatchResult descended = p.match;
  const MotionPrior motion = p.prior;
  p.match = match(view, found.pose, p.prior);
  if (between(p.match.pose, found.pose).translation().norm() > kSamePeak_m) {
    // The motion model pulled it out of the place that was found: look at that place on its own.
    p.prior.pose = found.pose;
    p.prior.information =
        Eigen::Vector3d(1.0 / (kSearchedPrior_m * kSearchedPrior_m), 1.0 / (kSearchedPrior_m * kSearchedPrior_m),
                        1.0 / (kSearchedPrior_rad * kSearchedPrior_rad))
            .asDiagonal();
    p.match = match(view, found.pose, p.prior);
    p.prior.pose = motion.pose;
  }
  // A place that fits beats one that does not, however odd the motion: odometry slips. Of two that fit, the likelier.
  const bool found_fits = acceptable(fit(view, p.match.pose), good);
  const bool descended_fits = acceptable(fit(view, descended.pose), good);
  const bool keep_descended = found_fits == descended_fits ? log_posterior(view, descended.pose, motion) >=
                                                                 log_posterior(view, p.match.pose, motion)
                                                           : descended_fits;
  if (keep_descended) {
    p.match = descended;
    p.prior = motion;
  }
  return found;
}

std::optional<Pose2> ScanRegistration::second_place(const MapView& view, const Particle& p,
                                                    const CorrelativeResult& found) const {
  if (found.second_score <= options_.ambiguous_ratio * found.score) return std::nullopt;
  MotionPrior weak = p.prior;
  weak.pose = found.second_pose;
  const Pose2 other = match(view, found.second_pose, weak).pose;
  const Pose2 apart = between(p.match.pose, other);
  if (std::hypot(apart.x, apart.y) < kSamePeak_m && std::abs(apart.yaw) < kSamePeak_rad) return std::nullopt;
  const double loss = log_posterior(view, p.match.pose, p.prior) - log_posterior(view, other, p.prior);
  return loss < kSecondPlaceLoss ? std::optional<Pose2>(other) : std::nullopt;
}

}  // namespace submapd
