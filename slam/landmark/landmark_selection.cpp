#include "slam/landmark/landmark_selection.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "slam/landmark/landmark_candidates.hpp"
#include "slam/landmark/landmark_observations.hpp"

namespace submapd {
namespace {

constexpr std::size_t kEnoughLandmarks = 4;  // up to here those that repeat shared scans fill up
constexpr double kMaxResidual_m = 0.03;
constexpr double kMaxResidualSparse_m = 0.05;
constexpr double kSparseStep_rad = 0.0131;  // 0.75 deg between beams, such scanners also count in centimetres

double max_residual_m(const FinishedSubmap& submap) {
  const bool sparse = !submap.keyframes.empty() && submap.keyframes.front().geometry.angle_step_rad > kSparseStep_rad;
  return sparse ? kMaxResidualSparse_m : kMaxResidual_m;
}

struct Pair {
  const SubmapView& a;
  const SubmapView& b;
  const Pose2& a_from_b;
  const LandmarkOptions& options;
};

// The candidate with its place in b and its observations; nothing if b shows something else or a side does not see it.
std::optional<VirtualLandmark> make_landmark(const Pair& pair, const LandmarkCandidate& candidate) {
  const double residual_m = std::max(max_residual_m(pair.a.submap), max_residual_m(pair.b.submap));
  const auto in_b = refine_place(candidate, pair.a.surface, pair.b.surface, pair.a_from_b, residual_m, pair.options);
  if (!in_b) {
    return std::nullopt;
  }
  const int count = pair.options.observations_per_side;
  const double range_m = pair.options.max_range_m;
  VirtualLandmark landmark;
  landmark.a = pair.a.submap.id.index;
  landmark.b = pair.b.submap.id.index;
  landmark.in_a = candidate.place;
  landmark.in_b = in_b->place;
  landmark.covariance_a = candidate.covariance;
  landmark.covariance_b = in_b->covariance;
  landmark.seen_from_a = observers_of(landmark.in_a, pair.a.submap, pair.b.submap, count, range_m);
  landmark.seen_from_b = observers_of(landmark.in_b, pair.b.submap, pair.a.submap, count, range_m);
  if (landmark.seen_from_a.empty() || landmark.seen_from_b.empty()) {
    return std::nullopt;
  }
  return landmark;
}

// Whether each side has an observation from a key-frame of its own. One seen by shared key-frames only repeats what
// they tie together already.
bool tells_something_new(const VirtualLandmark& landmark, const Pair& pair) {
  const auto any_fresh = [](const std::vector<std::uint32_t>& seen_from, const FinishedSubmap& submap,
                            const FinishedSubmap& other) {
    return std::any_of(seen_from.begin(), seen_from.end(),
                       [&](std::uint32_t keyframe) { return !has_scan(other, submap.keyframes[keyframe].scan_index); });
  };
  return any_fresh(landmark.seen_from_a, pair.a.submap, pair.b.submap) &&
         any_fresh(landmark.seen_from_b, pair.b.submap, pair.a.submap);
}

}  // namespace

std::vector<VirtualLandmark> choose_landmarks(const SubmapView& a, const SubmapView& b, const SubmapMatch& match,
                                              const LandmarkOptions& options) {
  std::vector<VirtualLandmark> landmarks;
  if (!a.plane) {
    return landmarks;
  }
  const std::vector<LandmarkCandidate> candidates =
      find_candidates(a.submap, *a.plane, a.surface, b.surface, match.a_from_b, options);
  const Pair pair{a, b, match.a_from_b, options};
  const auto most = static_cast<std::size_t>(std::max(0, options.max_landmarks));
  std::vector<VirtualLandmark> repeating;  // would hold, but tell little
  GreedyChoice choice(candidates, options.min_spacing_m);
  while (landmarks.size() < most) {
    const std::optional<std::size_t> offered = choice.next();
    if (!offered) {
      break;
    }
    std::optional<VirtualLandmark> landmark = make_landmark(pair, candidates[*offered]);
    if (!landmark) {
      continue;
    }
    if (tells_something_new(*landmark, pair)) {
      landmarks.push_back(std::move(*landmark));
      choice.keep();
    } else {
      repeating.push_back(std::move(*landmark));
    }
  }
  for (VirtualLandmark& landmark : repeating) {
    const bool apart = std::all_of(landmarks.begin(), landmarks.end(), [&](const VirtualLandmark& kept) {
      return (kept.in_a - landmark.in_a).norm() >= options.min_spacing_m;
    });
    if (landmarks.size() < std::min(most, kEnoughLandmarks) && apart) {
      landmarks.push_back(std::move(landmark));
    }
  }
  return landmarks;
}

}  // namespace submapd
