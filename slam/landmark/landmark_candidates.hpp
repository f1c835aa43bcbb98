// Spots of a sub-map that can serve as virtual landmarks, and what its map says about their place (design
// notes 8.1, 8.3).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/landmark/landmark_selection.hpp"
#include "slam/loop/cell_plane.hpp"
#include "slam/loop/surface_index.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

struct LandmarkCandidate {
  Eigen::Vector2d place = Eigen::Vector2d::Zero();           // in a's frame, m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();  // as a's map shows it, inflated, m^2
};

// Well-seen surface points of a that b has as well, the best one within every half metre; best first.
[[nodiscard]] std::vector<LandmarkCandidate> find_candidates(const FinishedSubmap& a, const CellPlane& plane_a,
                                                             const SurfaceIndex& surface_a,
                                                             const SurfaceIndex& surface_b, const Pose2& a_from_b,
                                                             const LandmarkOptions& options);

struct LandmarkPlace {
  Eigen::Vector2d place = Eigen::Vector2d::Zero();           // in b's frame, m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();  // inflated, m^2
};

// Where b's own map shows the spot: a's surface around it, shifted onto b's. Nothing if the shift or what remains after
// it is too large, for then the two do not show the same thing.
[[nodiscard]] std::optional<LandmarkPlace> refine_place(const LandmarkCandidate& candidate,
                                                        const SurfaceIndex& surface_a, const SurfaceIndex& surface_b,
                                                        const Pose2& a_from_b, double max_residual_m,
                                                        const LandmarkOptions& options);

// Indices of at most `count` of `candidates`, greedily D-optimal for the relative pose and min_spacing apart; the
// caller says of each pick whether it holds.
class GreedyChoice {
 public:
  GreedyChoice(const std::vector<LandmarkCandidate>& candidates, double min_spacing_m);

  // The candidate that tells most beyond those kept, of those not yet offered; nothing if none is left.
  [[nodiscard]] std::optional<std::size_t> next();
  // Keeps the candidate that next() gave last.
  void keep();

 private:
  [[nodiscard]] Eigen::Matrix3d information_of(std::size_t i) const;

  const std::vector<LandmarkCandidate>& candidates_;
  double min_spacing_m_;
  Eigen::Vector2d middle_ = Eigen::Vector2d::Zero();
  Eigen::Matrix3d information_;
  std::vector<bool> open_;
  std::size_t last_ = 0;
};

}  // namespace submapd
