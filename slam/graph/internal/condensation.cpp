#include "slam/graph/internal/condensation.hpp"

#include <Eigen/LU>
#include <algorithm>

#include "slam/graph/internal/final_graph.hpp"
#include "slam/graph/internal/least_squares.hpp"
#include "slam/graph/internal/live_graph.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"

namespace submapd::graph {
namespace {

constexpr std::uint32_t kNewest = 12;        // their loops are still to come
constexpr std::uint32_t kNewestAtLeast = 3;  // the next one is linked to the newest
// A tie that is so much looser than the way there is already would add less than a quarter to what is known.
constexpr double kLooser = 4.0;
// How well a sub-map must be tied to its hub to be redundant: 10 cm for a place half a sub-map away.
constexpr double kTiedM2 = 0.1 * 0.1;

Eigen::Matrix3d inverse_of(const Eigen::Matrix3d& information) {
  // A degenerate sum of landmarks says as much as a break.
  const auto white = whitening(information);
  return white ? Eigen::Matrix3d(white->transpose() * *white) : pose_covariance(kBreakM, kBreakRad);
}

Eigen::Matrix3d information_of(const Eigen::Matrix3d& covariance, double scale = 1.0) {
  const Eigen::Matrix3d white = whitening_or_soft(covariance, scale);
  return white.transpose() * white;
}

// What landmarks say about a_from_b at the present poses, under the live graph's loss.
Eigen::Matrix3d information_of(const GraphModel& model, const std::vector<VirtualLandmark>& landmarks, double scale) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const VirtualLandmark& landmark : landmarks) {
    const Pose2 a_from_b = between(model.poses[landmark.a], model.poses[landmark.b]);
    const Eigen::Matrix2d R = rotation(a_from_b.yaw);
    const Eigen::Matrix2d covariance =
        live_covariance(landmark.covariance_a) + R * live_covariance(landmark.covariance_b) * R.transpose();
    const Eigen::Vector2d turned = R * landmark.in_b;
    const Eigen::Vector2d e = landmark.in_a - a_from_b.translation() - turned;
    Eigen::Matrix<double, 2, 3> J;
    J << 1.0, 0.0, -turned.y(), 0.0, 1.0, turned.x();
    const Eigen::Matrix2d information = covariance.inverse();
    sum += scale / (1.0 + e.dot(information * e)) * (J.transpose() * information * J);
  }
  return sum;
}

}  // namespace

Condenser::Condenser(GraphModel& model) : model_(model), coverage_(model) {
  for (std::uint32_t k = 1; k < model.submaps.size(); ++k) {
    if (!model.has_link(k)) continue;
    const ChainLink& link = model.links[k];
    const double scale = link_scale(link);
    tie(k - 1, k, information_of(link.edge.covariance, scale) + information_of(model, link.landmarks, scale), false);
  }
  for (const CondensedEdge& edge : model.edges) {
    tie(edge.a, edge.b, information_of(edge.a_from_b.covariance), edge.loop);
  }
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    tie(record.loop.match.a, record.loop.match.b,
        model.parts.landmark_rows ? information_of(model, record.landmarks, 1.0)
                                  : information_of(model.measured(record).covariance),
        true);
  }
}

void Condenser::tie(std::uint32_t a, std::uint32_t b, const Eigen::Matrix3d& information, bool loop) {
  PairTie& tie = ties_[{a, b}];
  tie.information += information;
  tie.loop = tie.loop || loop;
}

UncertainPose Condenser::a_from_b(const Pair& pair) const {
  return {between(model_.poses[pair.first], model_.poses[pair.second]), inverse_of(ties_.at(pair).information)};
}

std::vector<Condenser::Spoke> Condenser::spokes_of(std::uint32_t k) const {
  std::vector<Spoke> spokes;
  for (const auto& [pair, tie] : ties_) {
    if (pair.first == k) spokes.push_back({pair.second, a_from_b(pair), tie.loop});
    if (pair.second == k) spokes.push_back({pair.first, inverse(a_from_b(pair)), tie.loop});
  }
  std::stable_sort(spokes.begin(), spokes.end(), [](const Spoke& p, const Spoke& q) {
    return spread_m2(p.k_from_to.covariance) < spread_m2(q.k_from_to.covariance);
  });
  return spokes;
}

std::optional<std::uint32_t> Condenser::redundant() const {
  std::vector<bool> excluded(model_.submaps.size(), true);
  for (std::size_t k = 1; k + kNewest < excluded.size(); ++k) excluded[k] = model_.submaps[k].condensed();
  for (const LoopRecord& record : model_.loops) {  // what is pending may yet be confirmed
    if (record.loop.state == LoopState::kPending) excluded[record.loop.match.a] = excluded[record.loop.match.b] = true;
  }
  std::vector<Pair> ranked;  // (redundancy, sub-map)
  for (std::uint32_t k = 0; k < excluded.size(); ++k) {
    if (excluded[k]) continue;
    if (const std::uint32_t redundancy = coverage_.redundancy(k); redundancy > 0) ranked.emplace_back(redundancy, k);
  }
  std::sort(ranked.begin(), ranked.end(),
            [](const Pair& p, const Pair& q) { return std::pair(q.first, p.second) < std::pair(p.first, q.second); });
  for (const Pair& candidate : ranked) {
    const std::vector<Spoke> spokes = spokes_of(candidate.second);
    if (!spokes.empty() && spread_m2(spokes.front().k_from_to.covariance) <= kTiedM2) return candidate.second;
  }
  return std::nullopt;
}

std::optional<std::uint32_t> Condenser::oldest() const {
  for (std::uint32_t k = 1; k + kNewestAtLeast < model_.submaps.size(); ++k) {
    if (!model_.submaps[k].condensed()) return k;
  }
  return std::nullopt;
}

std::optional<Condensed> Condenser::step() {
  if (const auto k = redundant()) return condense(*k, SubmapState::kCondensed);
  if (const auto k = oldest()) return condense(*k, SubmapState::kFrozen);
  return std::nullopt;
}

// REQUIRES: `spokes` of one sub-map that has left ties_ and is condensed.
void Condenser::take_over(const Spoke& hub, const std::vector<Spoke>& spokes) {
  std::vector<Tie> ties;
  ties.reserve(ties_.size());
  for (const auto& [pair, tie] : ties_) ties.push_back({pair.first, pair.second, a_from_b(pair).covariance, tie.loop});
  const RelativeUncertainty others(model_, ties);
  const RelativePoses known = others.paths_from(hub.to);
  for (const Spoke& spoke : spokes) {
    if (spoke.to == hub.to) continue;
    UncertainPose edge = compose(inverse(hub.k_from_to), spoke.k_from_to);  // hub_from_spoke
    const Pair pair = std::minmax(hub.to, spoke.to);
    if (pair.first != hub.to) edge = inverse(edge);
    edge.mean = between(model_.poses[pair.first], model_.poses[pair.second]);
    const bool loop = hub.loop || spoke.loop;
    const auto at = std::lower_bound(model_.edges.begin(), model_.edges.end(), pair,
                                     [](const CondensedEdge& e, const Pair& p) { return Pair(e.a, e.b) < p; });
    const RelativePose& path = known[spoke.to];
    if (at != model_.edges.end() && Pair(at->a, at->b) == pair) {
      at->a_from_b.mean = edge.mean;
      at->a_from_b.covariance = inverse_of(inverse_of(at->a_from_b.covariance) + inverse_of(edge.covariance));
      at->loop = at->loop || loop;
    } else if (path.reached && kLooser * spread_m2(path.pose.covariance) < spread_m2(edge.covariance)) {
      continue;
    } else {
      model_.edges.insert(at, {pair.first, pair.second, edge, loop});
    }
    tie(pair.first, pair.second, inverse_of(edge.covariance), loop);
  }
}

Condensed Condenser::condense(std::uint32_t k, SubmapState state) {
  Condensed condensed{k, state, 0, 0};
  const std::vector<Spoke> spokes = spokes_of(k);
  // Without ties there is nothing to hang on but the gauge; a graph that is one piece does not come here.
  const Spoke hub = spokes.empty() ? Spoke{0, {between(model_.poses[k], model_.poses[0]), {}}, false} : spokes.front();
  const auto is_of_k = [k](const auto& of) { return of.a == k || of.b == k; };
  std::erase_if(model_.loops, [&](const LoopRecord& record) {
    if (!is_of_k(record.loop.match)) return false;
    ++(record.loop.state == LoopState::kConfirmed ? condensed.confirmed_loops : condensed.pending_loops);
    return true;
  });
  std::erase_if(model_.edges, is_of_k);
  std::erase_if(ties_, [k](const auto& tie) { return tie.first.first == k || tie.first.second == k; });
  coverage_.remove(k);

  SubmapRecord& record = model_.submaps[k];
  record.state = state;
  record.hub = hub.to;
  record.outline.reset();
  const TrackPoint middle = record.keyframes[middle_of(record)];
  record.keyframes.resize(1);
  if (model_.links[k].linked && middle.scan_index != record.keyframes.front().scan_index) {
    record.keyframes.push_back(middle);
  }
  record.keyframes.shrink_to_fit();
  model_.links[k].edge = inverse(hub.k_from_to);
  model_.links[k].landmarks = {};
  if (k + 1 < model_.links.size()) model_.links[k + 1].landmarks = {};
  for (std::size_t other = 0; other < model_.submaps.size(); ++other) {
    SubmapRecord& hanging = model_.submaps[other];
    if (!hanging.condensed() || hanging.hub != k) continue;
    hanging.hub = hub.to;
    model_.links[other].edge = compose(model_.links[k].edge, model_.links[other].edge);
  }
  take_over(hub, spokes);
  return condensed;
}

std::size_t middle_of(const SubmapRecord& record) {
  return record.keyframes.size() / 2;
}

void hang_condensed(const GraphModel& model, FinalResult& result) {
  const std::size_t solved = result.keyframes.size();
  const auto earlier = [](const OptimizedKeyframe& p, const OptimizedKeyframe& q) {
    return p.scan_index < q.scan_index;
  };
  const auto end = [&] { return result.keyframes.begin() + static_cast<std::ptrdiff_t>(solved); };
  for (std::uint32_t k = 0; k < model.submaps.size(); ++k) {
    const SubmapRecord& record = model.submaps[k];
    if (!record.condensed()) continue;
    const UncertainPose& hub_from_this = model.links[k].edge;
    const TrackPoint& middle = model.submaps[record.hub].keyframes[middle_of(model.submaps[record.hub])];
    const auto in_track = std::lower_bound(
        result.keyframes.begin(), end(), middle.scan_index,
        [](const OptimizedKeyframe& keyframe, std::uint64_t scan_index) { return keyframe.scan_index < scan_index; });
    const UncertainPose hub{compose(in_track->map_from_base, inverse(middle.pose)),
                            result.bounds[record.hub].covariance};
    const UncertainPose pose = compose(hub, hub_from_this);
    const TrackPoint& first = record.keyframes.front();
    result.submaps[k] = {k, pose.mean, record.state};
    result.bounds[k] = {first.stamp_us, pose.covariance};
    result.graph.poses.push_back({submap_id(k), pose.mean});
    const Eigen::Matrix3d white = whitening_or_soft(hub_from_this.covariance);
    result.graph.pose_edges.push_back(
        {submap_id(record.hub), submap_id(k), hub_from_this.mean, white.transpose() * white});
    // It may belong to a retained neighbour, too.
    const TrackPoint& kept = record.keyframes.back();
    const OptimizedKeyframe keyframe{kept.scan_index, kept.stamp_us, compose(pose.mean, kept.pose)};
    if (!std::binary_search(result.keyframes.begin(), end(), keyframe, earlier)) result.keyframes.push_back(keyframe);
  }
  std::stable_sort(result.keyframes.begin(), result.keyframes.end(), earlier);
}

}  // namespace submapd::graph
