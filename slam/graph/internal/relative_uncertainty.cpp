#include "slam/graph/internal/relative_uncertainty.hpp"

#include <functional>
#include <limits>
#include <queue>
#include <utility>

namespace submapd::graph {
namespace {

constexpr double kLeverM = 10.0;  // half a sub-map: what a heading error is worth in metres

double uncertainty(const Eigen::Matrix3d& covariance) {
  return covariance(0, 0) + covariance(1, 1) + kLeverM * kLeverM * covariance(2, 2);
}

}  // namespace

RelativeUncertainty::RelativeUncertainty(const GraphModel& model) : model_(model), edges_(model.submaps.size()) {
  const auto add = [this](std::uint32_t a, std::uint32_t b, const UncertainPose& a_from_b, bool loop) {
    edges_[a].push_back({b, a_from_b.covariance, loop});
    edges_[b].push_back({a, inverse(a_from_b).covariance, loop});
  };
  for (std::uint32_t k = 1; k < model.submaps.size(); ++k) add(k - 1, k, model.links[k].edge, false);
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    add(record.loop.match.a, record.loop.match.b, model.measured(record), true);
  }
}

const RelativePose& RelativeUncertainty::between_submaps(std::uint32_t a, std::uint32_t b) {
  auto found = known_.find(a);
  if (found == known_.end()) found = known_.emplace(a, paths_from(a)).first;
  return found->second[b];
}

std::vector<RelativePose> RelativeUncertainty::paths_from(std::uint32_t start) const {
  using Entry = std::pair<double, std::uint32_t>;
  std::vector<RelativePose> reached(edges_.size());
  std::vector<double> best(edges_.size(), std::numeric_limits<double>::infinity());
  std::vector<bool> settled(edges_.size(), false);
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  best[start] = 0.0;
  open.emplace(0.0, start);
  while (!open.empty()) {
    const std::uint32_t here = open.top().second;
    open.pop();
    if (settled[here]) continue;
    settled[here] = true;
    for (const Edge& edge : edges_[here]) {
      if (settled[edge.to]) continue;
      const UncertainPose step{between(model_.poses[here], model_.poses[edge.to]), edge.covariance};
      UncertainPose to = compose(reached[here].pose, step);
      const double length = uncertainty(to.covariance);
      if (!(length < best[edge.to])) continue;
      best[edge.to] = length;
      to.mean.yaw = wrap_angle(to.mean.yaw);
      reached[edge.to] = {to, reached[here].through_loop || edge.loop};
      open.emplace(length, edge.to);
    }
  }
  return reached;
}

}  // namespace submapd::graph
