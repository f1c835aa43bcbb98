#include "slam/graph/internal/manual_ties.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "slam/graph/internal/consistency.hpp"
#include "slam/graph/internal/loop_candidates.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"
#include "slam/graph/point_pairs.hpp"

namespace submapd::graph {
namespace {

constexpr std::size_t kSeenFrom = 5;
constexpr std::uint32_t kLeastGap = 2;   // nearer ones are linked
constexpr double kLeastEffect_m = 0.05;  // less is not worth a person's time

// The key-frames nearest to a spot, ascending.
std::vector<std::uint32_t> nearest_keyframes(const SubmapRecord& submap, const Eigen::Vector2d& place) {
  std::vector<std::uint32_t> all(submap.keyframes.size());
  for (std::uint32_t k = 0; k < all.size(); ++k) all[k] = k;
  const auto distance = [&](std::uint32_t k) { return (submap.keyframes[k].pose.translation() - place).norm(); };
  std::stable_sort(all.begin(), all.end(), [&](std::uint32_t p, std::uint32_t q) { return distance(p) < distance(q); });
  all.resize(std::min(all.size(), kSeenFrom));
  std::sort(all.begin(), all.end());
  return all;
}

// How far a pose is from where it was measured.
struct Strain {
  double off_m = 0.0;
  double sigmas = 0.0;
};

Strain strain(const Pose2& seen, const UncertainPose& measured) {
  const Pose2 off{seen.x - measured.mean.x, seen.y - measured.mean.y, seen.yaw - measured.mean.yaw};
  return {off.translation().norm(), std::sqrt(mahalanobis2(off, measured.covariance))};
}

TieStress stress(std::uint32_t a, std::uint32_t b, const UncertainPose& measured,
                 const std::vector<SubmapPose>& poses) {
  const Strain s = strain(between(poses[a].map_from_submap, poses[b].map_from_submap), measured);
  TieStress stress;
  stress.a = a;
  stress.b = b;
  stress.a_from_b = measured.mean;
  stress.covariance = measured.covariance;
  stress.off_m = s.off_m;
  stress.sigmas = s.sigmas;
  return stress;
}

SuspectPair untied(std::uint32_t a, std::uint32_t b, const Eigen::Matrix3d& covariance, double gain_nats) {
  return {a, b, SuspectPair::Kind::kUntied, std::sqrt(covariance(0, 0) + covariance(1, 1)), gain_nats, 0.0};
}

}  // namespace

LoopRecord tie_record(const GraphModel& model, const ManualTie& tie) {
  LoopRecord record;
  record.loop.state = LoopState::kConfirmed;
  record.loop.manual = true;
  SubmapMatch& match = record.loop.match;
  match.a = tie.a;
  match.b = tie.b;
  match.verdict = MatchVerdict::kAccepted;
  if (const Expected<PointPairPose> pose = relative_pose_of(tie.points, tie.sigma_m)) {
    match.a_from_b = pose->a_from_b;
    match.covariance = pose->covariance;
  }
  for (const TiePoint& point : tie.points) {
    VirtualLandmark landmark;
    landmark.a = tie.a;
    landmark.b = tie.b;
    landmark.in_a = point.in_a;
    landmark.in_b = point.in_b;
    landmark.covariance_a = landmark.covariance_b = tie.sigma_m * tie.sigma_m * Eigen::Matrix2d::Identity();
    landmark.seen_from_a = nearest_keyframes(model.submaps[tie.a], point.in_a);
    landmark.seen_from_b = nearest_keyframes(model.submaps[tie.b], point.in_b);
    record.place_in_b += point.in_b / static_cast<double>(tie.points.size());
    record.landmarks.push_back(std::move(landmark));
  }
  return record;
}

std::vector<TieStress> stress_of(const GraphModel& model, const std::vector<SubmapPose>& poses) {
  std::vector<TieStress> all;
  for (std::uint32_t k = 1; k < model.links.size(); ++k) {
    if (!model.has_link(k) || !model.links[k].linked) continue;
    all.push_back(stress(k - 1, k, model.links[k].edge, poses));
    all.back().link = true;
  }
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    all.push_back(stress(record.loop.match.a, record.loop.match.b, model.measured(record), poses));
    all.back().manual = record.loop.manual;
  }
  return all;
}

std::vector<SuspectPair> suspects_of(const GraphModel& model, const PairTools& tools, const LoopSearch& search,
                                     const std::vector<TieStress>& ties) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, SuspectPair> found;
  RelativeUncertainty uncertainty(model);
  for (std::uint32_t b = 1; b < model.submaps.size(); ++b) {
    if (!model.has_link(b) || model.links[b].linked || search.is_barred(b - 1, b)) continue;
    const Eigen::Matrix3d& covariance = uncertainty.between_submaps(b - 1, b).pose.covariance;  // across a break
    found[{b - 1, b}] = untied(b - 1, b, covariance, information_gain(covariance));
  }
  for (std::uint32_t b = kLeastGap; b < model.submaps.size(); ++b) {
    if (model.submaps[b].condensed()) continue;
    const auto barred = [&](std::uint32_t a, const Pose2&) { return search.is_barred(a, b); };
    for (const LoopCandidate& candidate : rank_candidates(model, tools, uncertainty, b, kLeastGap, barred)) {
      found[{candidate.a, b}] = untied(candidate.a, b, candidate.prior.covariance, candidate.value);
    }
  }
  for (const LoopRecord& record : model.loops) {
    const SubmapMatch& match = record.loop.match;
    if (record.loop.state == LoopState::kConfirmed) {
      found.erase({match.a, match.b});
      continue;
    }
    const Strain s = strain(between(model.poses[match.a], model.poses[match.b]), model.measured(record));
    SuspectPair& suspect = found[{match.a, match.b}];
    suspect.a = match.a;
    suspect.b = match.b;
    suspect.kind = SuspectPair::Kind::kPending;
    suspect.effect_m = s.off_m;
    suspect.sigmas = s.sigmas;
  }
  for (const TieStress& tie : ties) {
    if (tie.sigmas * tie.sigmas < kChi2Conflict) continue;
    SuspectPair& suspect = found[{tie.a, tie.b}];
    suspect = {tie.a, tie.b, SuspectPair::Kind::kStrained, tie.off_m, 0.0, tie.sigmas};
  }
  std::vector<SuspectPair> all;
  for (const auto& [pair, suspect] : found) {
    if (suspect.effect_m >= kLeastEffect_m) all.push_back(suspect);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const SuspectPair& p, const SuspectPair& q) { return p.effect_m > q.effect_m; });
  return all;
}

}  // namespace submapd::graph
