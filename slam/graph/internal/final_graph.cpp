#include "slam/graph/internal/final_graph.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

#include "slam/graph/internal/condensation.hpp"

namespace submapd::graph {
namespace {

constexpr int kFinalIterations = 50;
// Loops have been judged by now: the loss only has to spoil single landmarks (a cabinet moved), not whole loops, so it
// starts later than live (95 % efficiency for Gaussian errors).
constexpr double kFinalCauchyScale = 2.385;
constexpr double kPlainScale = 1e4;  // no residual comes near it: plain squares
constexpr double kStepFloorM = 0.002;
constexpr double kStepFloorRad = 0.03 * kDegree;
// Sub-map vertices are names for key-frames, not measurements.
constexpr double kIdentityInformation = 1e8;

std::uint32_t position_of(const TrackGraph& graph, std::uint64_t scan_index) {
  const auto found = std::lower_bound(
      graph.track.begin(), graph.track.end(), scan_index,
      [](const OptimizedKeyframe& keyframe, std::uint64_t index) { return keyframe.scan_index < index; });
  return static_cast<std::uint32_t>(found - graph.track.begin());
}

// A row between the middle key-frames of two sub-maps, for what is known of the sub-maps as a whole.
void add_edge(TrackGraph& graph, const GraphModel& model, std::uint32_t a, std::uint32_t b,
              const UncertainPose& a_from_b) {
  const TrackPoint& in_a = model.submaps[a].keyframes[middle_of(model.submaps[a])];
  const TrackPoint& in_b = model.submaps[b].keyframes[middle_of(model.submaps[b])];
  const Eigen::Matrix3d exact = Eigen::Matrix3d::Zero();
  const UncertainPose row =
      compose(compose(UncertainPose{inverse(in_a.pose), exact}, a_from_b), UncertainPose{in_b.pose, exact});
  graph.chain.push_back(
      {position_of(graph, in_a.scan_index), position_of(graph, in_b.scan_index), row.mean, row.covariance});
}

// Every key-frame once, posed by the oldest sub-map that holds it, and chained inside sub-maps.
void add_track(TrackGraph& graph, const GraphModel& model) {
  for (std::uint32_t k = 0; k < model.submaps.size(); ++k) {
    if (model.submaps[k].condensed()) continue;
    const auto& keyframes = model.submaps[k].keyframes;
    for (std::size_t i = 0; i < keyframes.size(); ++i) {
      const TrackPoint& point = keyframes[i];
      if (!graph.track.empty() && point.scan_index <= graph.track.back().scan_index) continue;
      const auto here = static_cast<std::uint32_t>(graph.track.size());
      if (i > 0) {
        // The one before in this sub-map; as a rule it is the newest point of the track.
        const std::uint32_t before = position_of(graph, keyframes[i - 1].scan_index);
        graph.chain.push_back({before, here, between(keyframes[i - 1].pose, point.pose),
                               point.step() + pose_covariance(kStepFloorM, kStepFloorRad)});
      } else if (model.has_link(k)) {
        // A break: only the odometry frame says where it goes on.
        const Pose2 odom_from_last =
            compose(model.submaps[k - 1].odom_from_submap, model.submaps[k - 1].keyframes.back().pose);
        const Pose2 odom_from_here = compose(model.submaps[k].odom_from_submap, point.pose);
        graph.chain.push_back(
            {here - 1, here, between(odom_from_last, odom_from_here), pose_covariance(kBreakM, kBreakRad)});
      }
      graph.track.push_back({point.scan_index, point.stamp_us, compose(model.poses[k], point.pose)});
    }
  }
  for (const SubmapRecord& submap : model.submaps) {
    graph.first_of_submap.push_back(submap.condensed() ? kNoTrackPoint
                                                       : position_of(graph, submap.keyframes.front().scan_index));
  }
  for (const CondensedEdge& edge : model.edges) add_edge(graph, model, edge.a, edge.b, edge.a_from_b);
}

// One row a side, from the middle one of the key-frames that see the spot: more would repeat the same evidence, and a
// landmark of two rows is one between their two poses (least_squares.hpp).
void add_side(TrackGraph& graph, const SubmapRecord& submap, const std::vector<std::uint32_t>& seen_from,
              const Eigen::Vector2d& place, const Eigen::Matrix2d& covariance) {
  const TrackPoint& from = submap.keyframes[seen_from[seen_from.size() / 2]];
  const LandmarkObservation seen = observation_of(place, covariance, from.pose);
  graph.sights.push_back({position_of(graph, from.scan_index), static_cast<std::uint32_t>(graph.landmarks.size()),
                          seen.z, seen.covariance});
}

// Every `stride`-th landmark of a pair; what is taken stands for what is left out: all in all it is worth as much.
// REQUIRES: usable landmarks (see LoopSearch).
void add_sights(TrackGraph& graph, const GraphModel& model, const std::vector<VirtualLandmark>& landmarks,
                double covariance_scale, std::size_t stride) {
  if (landmarks.empty()) return;
  const std::size_t taken = (landmarks.size() + stride - 1) / stride;
  const double scale = covariance_scale * static_cast<double>(taken) / static_cast<double>(landmarks.size());
  for (std::size_t k = 0; k < landmarks.size(); k += stride) {
    const VirtualLandmark& l = landmarks[k];
    add_side(graph, model.submaps[l.a], l.seen_from_a, l.in_a, scale * l.covariance_a);
    add_side(graph, model.submaps[l.b], l.seen_from_b, l.in_b, scale * l.covariance_b);
    graph.landmarks.emplace_back(0.5 * (transform(model.poses[l.a], l.in_a) + transform(model.poses[l.b], l.in_b)));
  }
}

}  // namespace

TrackGraph build_track_graph(const GraphModel& model) {
  TrackGraph graph;
  add_track(graph, model);
  std::size_t offered = 0;
  for (const ChainLink& link : model.links) offered += link.landmarks.size();
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    if (model.parts.landmark_rows) {
      offered += record.landmarks.size();
    } else {
      add_edge(graph, model, record.loop.match.a, record.loop.match.b, model.measured(record));
    }
  }
  const std::size_t stride = std::max<std::size_t>(1, (2 * offered + kMostSights - 1) / kMostSights);
  for (const ChainLink& link : model.links) add_sights(graph, model, link.landmarks, 2.0, stride);
  if (!model.parts.landmark_rows) return graph;
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state == LoopState::kConfirmed) add_sights(graph, model, record.landmarks, 1.0, stride);
  }
  return graph;
}

Expected<SolveSummary> solve_track_graph(TrackGraph& graph, bool robust_loss, const std::atomic<bool>* cancelled) {
  std::vector<bool> needed(graph.track.size(), false);
  for (const auto& row : graph.sights) needed[row.track_point] = true;
  const TrackChains chains(graph.chain, std::move(needed));
  LeastSquaresGraph problem;
  std::vector<std::uint32_t> place(graph.track.size(), 0);  // of kept track points in the problem
  for (std::uint32_t k = 0; k < graph.track.size(); ++k) {
    place[k] = static_cast<std::uint32_t>(problem.poses.size());
    if (chains.is_kept(k)) problem.poses.push_back(graph.track[k].map_from_base);
  }
  problem.points = graph.landmarks;
  for (const ChainRow& row : chains.rows()) {
    problem.pose_rows.push_back({place[row.from], place[row.to], row.measurement, whitening_or_soft(row.covariance)});
  }
  for (const auto& row : graph.sights) {
    problem.point_rows.push_back({place[row.track_point], row.landmark, row.z, *whitening(row.covariance)});
  }
  const auto summary = solve(problem, {kFinalIterations, robust_loss ? kFinalCauchyScale : kPlainScale, cancelled});
  if (!summary) return summary;
  std::vector<Pose2> solved(graph.track.size());
  for (std::uint32_t k = 0; k < solved.size(); ++k) {
    if (chains.is_kept(k)) solved[k] = problem.poses[place[k]];
  }
  chains.place_others(solved);
  for (std::size_t k = 0; k < solved.size(); ++k) graph.track[k].map_from_base = solved[k];
  graph.landmarks = std::move(problem.points);
  return summary;
}

GraphExport export_graph(const TrackGraph& graph) {
  GraphExport out;
  const auto id_of = [&](std::uint32_t track_point) { return track_point_id(graph.track[track_point].scan_index); };
  for (const OptimizedKeyframe& keyframe : graph.track) {
    out.poses.push_back({track_point_id(keyframe.scan_index), keyframe.map_from_base});
  }
  for (std::uint32_t k = 0; k < graph.first_of_submap.size(); ++k) {
    const std::uint32_t first = graph.first_of_submap[k];
    if (first == kNoTrackPoint) continue;
    out.poses.push_back({submap_id(k), graph.track[first].map_from_base});
    out.pose_edges.push_back({id_of(first), submap_id(k), {}, kIdentityInformation * Eigen::Matrix3d::Identity()});
  }
  for (std::size_t k = 0; k < graph.landmarks.size(); ++k) out.points.push_back({landmark_id(k), graph.landmarks[k]});
  for (const auto& row : graph.chain) {
    const Eigen::Matrix3d white = whitening_or_soft(row.covariance);
    out.pose_edges.push_back({id_of(row.from), id_of(row.to), row.measurement, white.transpose() * white});
  }
  for (const auto& row : graph.sights) {
    out.point_edges.push_back({id_of(row.track_point), landmark_id(row.landmark), row.z, row.covariance.inverse()});
  }
  if (!graph.track.empty()) out.fixed.push_back(id_of(0));
  return out;
}

}  // namespace submapd::graph
