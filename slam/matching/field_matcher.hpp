// Stage 1: Gauss-Newton on the truncated distance field (design notes 5.1). Wide basin, flat valley floor.
#pragma once

#include <span>

#include "slam/grid/distance_layers.hpp"
#include "slam/matching/match_types.hpp"
#include "slam/matching/scan_points.hpp"

namespace submapd {

struct FieldMatcherOptions {
  int max_iterations = 10;
  double sigma_m = 0.05;   // of one point's distance
  double cauchy_m = 0.15;  // c of the weight 1 / (1 + (d / c)^2)
  double kappa = 8.0;      // neighbouring beams are correlated: information counts 1 / kappa
  double stop_m = 0.003;   // the surfaces take it from there
  double stop_rad = 0.0005;
};

// Pose that brings the points onto the field's valleys, starting from `start`. Thread-safe on const views.
[[nodiscard]] MatchResult match_field(std::span<const ScanPoint> points, const DistanceView& field, double cell_m,
                                      const Pose2& start, const MotionPrior& prior, const FieldMatcherOptions& options);

// log p(z | m, x) of design notes 6.2, tempered by 1 / kappa; points on unknown cells count as half the radius away.
struct LikelihoodOptions {
  double sigma_m = 0.06;
  double hit_share = 0.9;  // z_h; the rest is a floor at three sigma
  double kappa = 30.0;
};
class LikelihoodTable {
 public:
  LikelihoodTable(const LikelihoodOptions& options, double cell_m);
  // Tempered log-likelihood of the points at the pose.
  [[nodiscard]] double log_likelihood(std::span<const ScanPoint> points, const DistanceView& field, double cell_m,
                                      const Pose2& pose) const;

 private:
  std::array<float, kDistanceFar + 1> log_p_{};
  double kappa_;
};

}  // namespace submapd
