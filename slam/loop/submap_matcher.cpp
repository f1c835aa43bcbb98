#include "slam/loop/submap_matcher.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "slam/base/small_matrix.hpp"
#include "slam/grid/surface_map.hpp"
#include "slam/loop/internal/match_grid.hpp"
#include "slam/loop/internal/placement_search.hpp"
#include "slam/loop/internal/search_points.hpp"
#include "slam/loop/internal/surface_alignment.hpp"
#include "slam/loop/internal/verification.hpp"

namespace submapd {
namespace {

using internal::Alignment;

constexpr double kMinRawShare = 0.08;  // of the best possible search score: the overlap may be a corner of b
constexpr double kWeakSigma_m = 0.02;
constexpr double kLostSigma_m = 5.0;  // a direction without any information is not surer than this
constexpr double kRefineReach_m = 0.3;
constexpr double kRefineReach_rad = 0.0524;  // 3 deg
constexpr double kTightSigma_m = 0.10;       // a prior within both of these puts the alignment into its minimum
constexpr double kTightSigma_rad = 0.0087;   // 0.5 deg
constexpr double kDistinct_m = 0.5;          // a second peak is one that far from the best
constexpr double kDistinct_rad = 0.0873;     // 5 deg
constexpr double kWideWindow_rad = std::numbers::pi / 3.0;

// Covariance of a_from_b and what is weak in it, from the information about the pivot.
struct Confidence {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix2d strong = Eigen::Matrix2d::Identity();  // projector on the directions of translation that are not weak
  bool weak = false;
  bool rotation_weak = false;
};

Confidence judge_information(const Alignment& alignment, const SubmapMatcherOptions& options) {
  // Rotation scaled by the arm, so that all entries are metres. Pairs seen from both sides count twice, hence the half.
  const double arm = std::max(alignment.rms_radius_m, 0.1);
  const Eigen::DiagonalMatrix<double, 3> scale(1.0, 1.0, 1.0 / arm);
  const Eigen::Matrix3d scaled = scale * alignment.information * scale / (2.0 * options.information_inflation);
  const double noise = kNormalNoiseShare * scaled.topLeftCorner<2, 2>().trace();
  const PrincipalAxes<3> principal = principal_axes(scaled);

  Confidence confidence;
  Eigen::Matrix3d about_pivot = Eigen::Matrix3d::Zero();
  const double least = 1.0 / (kLostSigma_m * kLostSigma_m);
  for (int k = 0; k < 3; ++k) {
    const double information = std::max(principal.values[k] - noise, least);
    const Eigen::Vector3d direction = principal.axes.col(k);
    about_pivot += direction * direction.transpose() / information;
    if (1.0 / std::sqrt(information) > kWeakSigma_m) {
      confidence.weak = true;
      confidence.rotation_weak = confidence.rotation_weak || std::abs(direction.z()) > 0.5;
      const Eigen::Vector2d along = direction.head<2>();
      if (along.norm() > 0.5) {
        const Eigen::Vector2d unit = along.normalized();
        confidence.strong -= unit * unit.transpose() * confidence.strong;
      }
    }
  }
  about_pivot = scale * about_pivot * scale;
  about_pivot.diagonal() +=
      Eigen::Vector3d(options.floor_sigma_m, options.floor_sigma_m, options.floor_sigma_rad).cwiseAbs2();
  // A turn about the pivot moves the origin of b on a circle around it.
  const Eigen::Vector2d lever = alignment.a_from_b.translation() - alignment.pivot;
  Eigen::Matrix3d to_origin = Eigen::Matrix3d::Identity();
  to_origin(0, 2) = -lever.y();
  to_origin(1, 2) = lever.x();
  confidence.covariance = to_origin * about_pivot * to_origin.transpose();
  return confidence;
}

// Whether a on b and b on a, each by itself, come to the same place in all but the weak directions.
bool is_symmetric(const SubmapView& a, const SubmapView& b, const Alignment& joint, const Confidence& confidence,
                  const SubmapMatcherOptions& options) {
  const Alignment a_on_b = internal::align_surfaces(a.surface, b.surface, joint.a_from_b,
                                                    internal::AlignDirection::kAOnB, internal::AlignStages::kFineOnly);
  const Alignment b_on_a = internal::align_surfaces(a.surface, b.surface, joint.a_from_b,
                                                    internal::AlignDirection::kBOnA, internal::AlignStages::kFineOnly);
  if (a_on_b.pairs == 0 || b_on_a.pairs == 0) {
    return false;
  }
  const Eigen::Vector2d pivot_in_b = transform(inverse(joint.a_from_b), joint.pivot);
  const Eigen::Vector2d apart = transform(a_on_b.a_from_b, pivot_in_b) - transform(b_on_a.a_from_b, pivot_in_b);
  const double turn = std::abs(wrap_angle(a_on_b.a_from_b.yaw - b_on_a.a_from_b.yaw));
  return (confidence.strong * apart).norm() <= options.max_asymmetry_m &&
         (confidence.rotation_weak || turn <= options.max_asymmetry_rad);
}

// Fills in the figures at a_from_b and the verdict of the tests that search() and refine() share.
void verify(const SubmapView& a, const SubmapView& b, const Alignment& alignment, const SubmapMatcherOptions& options,
            SubmapMatch& match) {
  const Confidence confidence = judge_information(alignment, options);
  match.a_from_b = alignment.a_from_b;
  match.covariance = confidence.covariance;
  match.weak = confidence.weak;
  const internal::Overlap overlap = internal::measure_overlap(a, b, match.a_from_b);
  match.overlap_m2 = overlap.area_m2;
  match.overlap_share = overlap.share;
  const internal::Agreement agreement = internal::measure_agreement(a, b, match.a_from_b);
  match.score = agreement.fitting;
  match.contradiction = agreement.contradicted;
  const bool corner = match.overlap_share < options.min_overlap_share;
  if (match.overlap_m2 < options.min_overlap_m2 || (corner && match.weak)) {
    match.verdict = MatchVerdict::kSmallOverlap;
  } else if (match.score < options.min_score) {
    match.verdict = MatchVerdict::kLowScore;
  } else if (options.contradiction_test && match.contradiction > options.max_contradiction) {
    match.verdict = MatchVerdict::kContradiction;
  } else if (!is_symmetric(a, b, alignment, confidence, options)) {
    match.verdict = MatchVerdict::kAsymmetric;
  } else {
    match.verdict = MatchVerdict::kAccepted;
  }
}

// Squared Mahalanobis distance of the match from the prior.
double prior_distance2(const SubmapMatch& match, const MatchPrior& prior) {
  const Eigen::Vector3d difference(match.a_from_b.x - prior.a_from_b.x, match.a_from_b.y - prior.a_from_b.y,
                                   wrap_angle(match.a_from_b.yaw - prior.a_from_b.yaw));
  const Eigen::Matrix3d covariance = prior.covariance + match.covariance;
  return difference.dot(solve_definite(covariance, difference));
}

bool is_tight(const MatchPrior& prior) {
  return prior.covariance(0, 0) + prior.covariance(1, 1) <= kTightSigma_m * kTightSigma_m &&
         prior.covariance(2, 2) <= kTightSigma_rad * kTightSigma_rad;
}

// Aligns the surfaces from `start` and judges the outcome, by the prior as well. Leaves `start` with kLowScore if too
// little can be paired.
void judge_placement(const SubmapView& a, const SubmapView& b, const Pose2& start, const MatchPrior& prior,
                     const SubmapMatcherOptions& options, SubmapMatch& match) {
  const Alignment alignment = internal::align_surfaces(a.surface, b.surface, start, internal::AlignDirection::kBoth,
                                                       internal::AlignStages::kCoarseToFine);
  if (alignment.pairs == 0) {
    match.a_from_b = start;
    match.verdict = MatchVerdict::kLowScore;
    return;
  }
  verify(a, b, alignment, options, match);
  if (match.verdict == MatchVerdict::kAccepted && prior_distance2(match, prior) > options.gate_chi2) {
    match.verdict = MatchVerdict::kGate;
  }
}

internal::SearchWindow window_of(const MatchPrior& prior, const FinishedSubmap& a, const FinishedSubmap& b,
                                 double cell_m, double radius_m, const SubmapMatcherOptions& options) {
  const auto half = [](double variance, double low, double high) {
    return std::clamp(3.0 * std::sqrt(std::max(variance, 0.0)), low, high);
  };
  internal::SearchWindow window;
  window.centre = prior.a_from_b;
  window.half_x_m = half(prior.covariance(0, 0), options.min_window_m, options.max_window_m);
  window.half_y_m = half(prior.covariance(1, 1), options.min_window_m, options.max_window_m);
  const double half_yaw = half(prior.covariance(2, 2), options.min_window_rad, options.max_window_rad);
  const double low = prior.a_from_b.yaw - half_yaw;
  const double high = prior.a_from_b.yaw + half_yaw;
  window.yaws_rad = half_yaw > kWideWindow_rad ? internal::angles_by_normals(a, b, low, high, cell_m, radius_m)
                                               : internal::angle_steps(low, high, cell_m, radius_m);
  return window;
}

SubmapMatch named(const FinishedSubmap& a, const FinishedSubmap& b, const Pose2& start) {
  SubmapMatch match;
  match.a = a.id.index;
  match.b = b.id.index;
  match.a_from_b = start;
  match.covariance = Eigen::Vector3d(kRefineReach_m, kRefineReach_m, kRefineReach_rad).cwiseAbs2().asDiagonal();
  return match;
}

}  // namespace

SubmapMatch SubmapMatcher::search(const SubmapView& a, const SubmapView& b, const MatchPrior& prior) const {
  SubmapMatch match = named(a.submap, b.submap, prior.a_from_b);
  match.covariance = prior.covariance;
  if (!a.plane || !b.plane) {
    return match;
  }
  if (is_tight(prior)) {
    // The gate would refuse whatever a search could find that the alignment does not, and any second peak with it.
    judge_placement(a, b, prior.a_from_b, prior, options_, match);
    return match;
  }
  const std::vector<Eigen::Vector2d> points = internal::thinned_points(b.surface);
  if (points.empty()) {
    return match;
  }
  // Searched at twice the cell: the alignment that follows catches what is decimetres off, and a search at full
  // resolution costs eight times as much.
  const CellPlane plane = a.plane->halved();
  const double cell_m = plane.cell_m();
  const internal::SearchWindow window =
      window_of(prior, a.submap, b.submap, cell_m, internal::outer_radius_m(points), options_);
  const internal::MatchGrid grid(plane, a.surface,
                                 internal::levels_for(std::max(window.half_x_m, window.half_y_m), cell_m));
  const internal::PlacementSearch placements(plane, grid, points, window);
  const double full_score = 255.0 * static_cast<double>(points.size());
  const auto found = placements.best(static_cast<std::int32_t>(kMinRawShare * full_score), nullptr);
  if (!found) {
    return match;
  }
  judge_placement(a, b, found->a_from_b, prior, options_, match);
  const internal::ExclusionZone zone{found->a_from_b, kDistinct_m, kDistinct_rad};
  const auto second =
      placements.best(static_cast<std::int32_t>(std::ceil(options_.max_second_peak * found->score)) + 1, &zone);
  if (!second) {
    return match;
  }
  if (second->exhausted) {
    match.second_peak = static_cast<double>(second->score) / static_cast<double>(found->score);
  } else {
    // The search's cells are coarse: what counts is whether the rival passes once it is aligned, if it stays a rival.
    SubmapMatch rival = named(a.submap, b.submap, second->a_from_b);
    judge_placement(a, b, second->a_from_b, prior, options_, rival);
    const Pose2 apart = between(match.a_from_b, rival.a_from_b);
    const bool distinct = apart.translation().norm() > kDistinct_m || std::abs(apart.yaw) > kDistinct_rad;
    if (rival.verdict == MatchVerdict::kAccepted && distinct) {
      if (match.verdict != MatchVerdict::kAccepted) return rival;
      match.second_peak = rival.score / match.score;
    }
  }
  if (match.verdict == MatchVerdict::kAccepted && match.second_peak > options_.max_second_peak) {
    match.verdict = MatchVerdict::kAmbiguous;
  }
  return match;
}

SubmapMatch SubmapMatcher::refine(const SubmapView& a, const SubmapView& b, const Pose2& start) const {
  SubmapMatch match = named(a.submap, b.submap, start);
  match.verdict = MatchVerdict::kLowScore;
  if (!a.plane || !b.plane) {
    return match;
  }
  const Alignment alignment = internal::align_surfaces(a.surface, b.surface, start, internal::AlignDirection::kBoth,
                                                       internal::AlignStages::kCoarseToFine);
  // Judged at the overlap, where the surfaces are, and not at an origin that may be far from it.
  const Eigen::Vector2d pivot_before = transform(start, transform(inverse(alignment.a_from_b), alignment.pivot));
  if (alignment.pairs == 0 || (pivot_before - alignment.pivot).norm() > kRefineReach_m ||
      std::abs(wrap_angle(alignment.a_from_b.yaw - start.yaw)) > kRefineReach_rad) {
    return match;
  }
  verify(a, b, alignment, options_, match);
  return match;
}

}  // namespace submapd
