#include "slam/landmark/landmark_selection.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "slam/landmark/landmark_candidates.hpp"
#include "slam/landmark/landmark_observations.hpp"
#include "slam/loop/cell_plane.hpp"
#include "slam/loop/surface_index.hpp"

namespace submapd {
namespace {

constexpr double kMaxResidual_m = 0.03;
constexpr double kMaxResidualSparse_m = 0.05;
constexpr double kSparseStep_rad = 0.0131;  // 0.75 deg between beams, such scanners also count in centimetres

double max_residual_m(const FinishedSubmap& submap) {
  const bool sparse = !submap.keyframes.empty() && submap.keyframes.front().geometry.angle_step_rad > kSparseStep_rad;
  return sparse ? kMaxResidualSparse_m : kMaxResidual_m;
}

}  // namespace

std::vector<VirtualLandmark> choose_landmarks(const FinishedSubmap& a, const FinishedSubmap& b,
                                              const SubmapMatch& match, const LandmarkOptions& options) {
  std::vector<VirtualLandmark> landmarks;
  const std::optional<CellPlane> plane_a = CellPlane::make(a);
  if (!plane_a) {
    return landmarks;
  }
  const SurfaceIndex surface_a(a);
  const SurfaceIndex surface_b(b);
  const std::vector<LandmarkCandidate> candidates =
      find_candidates(a, *plane_a, surface_a, surface_b, match.a_from_b, options);
  GreedyChoice choice(candidates, options.min_spacing_m);
  while (landmarks.size() < static_cast<std::size_t>(std::max(0, options.max_landmarks))) {
    const std::optional<std::size_t> offered = choice.next();
    if (!offered) {
      break;
    }
    const LandmarkCandidate& candidate = candidates[*offered];
    const auto in_b = refine_place(candidate, surface_a, surface_b, match.a_from_b,
                                   std::max(max_residual_m(a), max_residual_m(b)), options);
    if (!in_b) {
      continue;
    }
    const int count = options.observations_per_side;
    std::vector<LandmarkObservation> from_a =
        observe({a, b, candidate.place, candidate.covariance}, count, options.max_range_m);
    const std::vector<LandmarkObservation> from_b =
        observe({b, a, in_b->place, in_b->covariance}, count, options.max_range_m);
    if (from_a.empty() || from_b.empty()) {
      continue;
    }
    VirtualLandmark landmark;
    landmark.a = a.id.index;
    landmark.b = b.id.index;
    landmark.in_a = candidate.place;
    landmark.in_b = in_b->place;
    landmark.covariance_a = candidate.covariance;
    landmark.covariance_b = in_b->covariance;
    landmark.observations = std::move(from_a);
    landmark.observations.insert(landmark.observations.end(), from_b.begin(), from_b.end());
    landmarks.push_back(std::move(landmark));
    choice.keep();
  }
  return landmarks;
}

}  // namespace submapd
