// Matching of two finished sub-maps: branch and bound, refinement, verification (design notes, section 9).
#pragma once

#include <Eigen/Core>

#include "slam/base/pose2.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/loop/submap_view.hpp"

namespace submapd {

struct MatchPrior {
  Pose2 a_from_b;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // of (x, y, yaw) in a's frame
};

struct SubmapMatcherOptions {
  double min_window_m = 1.0;       // half width of the search window at least
  double min_window_rad = 0.0873;  // 5 deg
  double max_window_m = 15.0;
  double max_window_rad = 3.1416;
  double min_score = 0.60;  // of overlapping surface points
  double min_overlap_m2 = 25.0;
  double min_overlap_share = 0.10;  // of the smaller, unless walls fix the place in every direction
  double max_contradiction = 0.06;
  bool contradiction_test = true;  // [experiment]: off, `max_contradiction` is not asked
  double max_second_peak = 0.80;
  double max_asymmetry_m = 0.03;
  double max_asymmetry_rad = 0.0052;    // 0.3 deg
  double gate_chi2 = 16.27;             // three degrees of freedom, 99.9 %
  double information_inflation = 30.0;  // kappa: neighbouring beams are correlated (notes 5.4)
  double floor_sigma_m = 0.005;         // of every match, at the middle of the overlap: drift inside the sub-maps
  double floor_sigma_rad = 0.0009;      // 0.05 deg
};

// Stateless but for options: deterministic, callable from any one thread at a time.
class SubmapMatcher {
 public:
  explicit SubmapMatcher(const SubmapMatcherOptions& options) : options_(options) {}

  // Searches b's placement in a within 3 sigma of the prior, refines the best, judges it by every test of notes 9.2. If
  // it is refused, the next best may be the place; if both pass, neither is.
  // All figures are filled in as far as the match got; verdict says why it stopped.
  [[nodiscard]] SubmapMatch search(const SubmapView& a, const SubmapView& b, const MatchPrior& prior) const;

  // For sub-maps whose relative pose is known to a few centimetres (adjacent ones): refinement from `start` only, no
  // branch and bound, no second-peak test; falls back to `start` with verdict kLowScore when the refinement leaves it
  // by more than 0.3 m or 3 deg.
  [[nodiscard]] SubmapMatch refine(const SubmapView& a, const SubmapView& b, const Pose2& start) const;

 private:
  SubmapMatcherOptions options_;
};

}  // namespace submapd
