#include "slam/graph/internal/live_graph.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace submapd::graph {
namespace {

constexpr int kLiveIterations = 12;
constexpr double kCauchyScale = 1.0;
constexpr double kRigidSigmaM = 0.014;  // a side
constexpr double kJumpM = 0.5;
constexpr double kJumpRad = 5.0 * kDegree;

void add_landmarks(LeastSquaresGraph& graph, const std::vector<VirtualLandmark>& landmarks, double scale) {
  for (const VirtualLandmark& landmark : landmarks) {
    const auto white_a = whitening(live_covariance(landmark.covariance_a), scale);
    const auto white_b = whitening(live_covariance(landmark.covariance_b), scale);
    if (!white_a || !white_b) continue;
    const auto point = static_cast<std::uint32_t>(graph.points.size());
    graph.points.emplace_back(
        0.5 * (transform(graph.poses[landmark.a], landmark.in_a) + transform(graph.poses[landmark.b], landmark.in_b)));
    graph.point_rows.push_back({landmark.a, point, landmark.in_a, *white_a});
    graph.point_rows.push_back({landmark.b, point, landmark.in_b, *white_b});
  }
}

bool calls_for_jump(const GraphModel& model, const SubmapMatch& match) {
  const Pose2 off = between(match.a_from_b, between(model.poses[match.a], model.poses[match.b]));
  return off.translation().norm() > kJumpM || std::abs(off.yaw) > kJumpRad;
}

}  // namespace

double link_scale(const ChainLink& link) {
  return link.landmarks.empty() ? 1.0 : 0.5;
}

Eigen::Matrix2d live_covariance(const Eigen::Matrix2d& covariance) {
  return covariance + kRigidSigmaM * kRigidSigmaM * Eigen::Matrix2d::Identity();
}

LeastSquaresGraph build_live_graph(const GraphModel& model) {
  LeastSquaresGraph graph;
  graph.poses = model.poses;
  for (std::uint32_t k = 1; k < model.links.size(); ++k) {
    if (!model.has_link(k)) continue;
    const ChainLink& link = model.links[k];
    const double scale = link_scale(link);
    graph.pose_rows.push_back({k - 1, k, link.edge.mean, whitening_or_soft(link.edge.covariance, scale)});
    add_landmarks(graph, link.landmarks, scale);
  }
  for (const CondensedEdge& edge : model.edges) {
    graph.pose_rows.push_back({edge.a, edge.b, edge.a_from_b.mean, whitening_or_soft(edge.a_from_b.covariance)});
  }
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    if (model.parts.landmark_rows) {
      add_landmarks(graph, record.landmarks, 1.0);
    } else {
      const UncertainPose edge = model.measured(record);
      graph.pose_rows.push_back(
          {record.loop.match.a, record.loop.match.b, edge.mean, whitening_or_soft(edge.covariance)});
    }
  }
  return graph;
}

Expected<SolveSummary> solve_live(GraphModel& model, const std::vector<std::size_t>& news,
                                  const std::atomic<bool>* cancelled) {
  for (const std::size_t k : news) {
    const LoopRecord& record = model.loops[k];
    if (!calls_for_jump(model, record.loop.match)) continue;
    const double before = cost(build_live_graph(model), kCauchyScale);
    std::vector<Pose2> poses = spread_closure(model, record);
    poses.swap(model.poses);
    if (cost(build_live_graph(model), kCauchyScale) > before) poses.swap(model.poses);
  }
  LeastSquaresGraph graph = build_live_graph(model);
  const auto summary = solve(graph, {kLiveIterations, kCauchyScale, cancelled});
  if (summary) {
    model.poses = std::move(graph.poses);
    model.place_condensed();
  }
  return summary;
}

std::vector<Pose2> spread_closure(const GraphModel& model, const LoopRecord& record) {
  const std::uint32_t a = record.loop.match.a;
  const std::uint32_t b = record.loop.match.b;
  const Pose2 target = compose(model.poses[a], record.loop.match.a_from_b);
  std::vector<Pose2> poses = model.poses;
  // Shares of the closure that have been spent after each sub-map, a..b.
  std::vector<double> share_yaw(b - a + 1, 0.0);
  std::vector<double> share_xy(b - a + 1, 0.0);
  for (std::uint32_t k = a + 1; k <= b; ++k) {
    const Eigen::Matrix3d& covariance = model.links[k].edge.covariance;
    share_yaw[k - a] = share_yaw[k - a - 1] + covariance(2, 2);
    share_xy[k - a] = share_xy[k - a - 1] + covariance(0, 0) + covariance(1, 1);
  }
  const double turn = wrap_angle(target.yaw - poses[b].yaw);
  for (std::uint32_t k = a + 1; k <= b; ++k) {
    const double yaw = model.poses[k].yaw + turn * share_yaw[k - a] / share_yaw.back();
    poses[k] = compose(poses[k - 1], between(model.poses[k - 1], model.poses[k]));
    poses[k].yaw = yaw;
  }
  const Eigen::Vector2d left = target.translation() - poses[b].translation();
  for (std::uint32_t k = a + 1; k <= b; ++k) {
    poses[k].x += left.x() * share_xy[k - a] / share_xy.back();
    poses[k].y += left.y() * share_xy[k - a] / share_xy.back();
  }
  for (std::size_t k = b + 1; k < poses.size(); ++k) {
    const Pose2 relative = between(model.poses[b], model.poses[k]);
    const double yaw = model.poses[k].yaw + turn;
    poses[k] = compose(poses[b], relative);
    poses[k].yaw = yaw;
  }
  return poses;
}

}  // namespace submapd::graph
