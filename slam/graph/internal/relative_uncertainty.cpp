#include "slam/graph/internal/relative_uncertainty.hpp"

#include <functional>
#include <limits>
#include <queue>
#include <utility>

namespace submapd::graph {
namespace {

constexpr double kLeverM = 10.0;  // half a sub-map: what a heading error is worth in metres

}  // namespace

double spread_m2(const Eigen::Matrix3d& covariance) {
  return covariance(0, 0) + covariance(1, 1) + kLeverM * kLeverM * covariance(2, 2);
}

RelativeUncertainty::RelativeUncertainty(const GraphModel& model) : model_(model) {
  number_retained();
  for (std::uint32_t k = 1; k < model.submaps.size(); ++k) {
    if (model.has_link(k)) add(k - 1, k, model.links[k].edge, false);
  }
  for (const CondensedEdge& edge : model.edges) add(edge.a, edge.b, edge.a_from_b, edge.loop);
  for (const LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    add(record.loop.match.a, record.loop.match.b, model.measured(record), true);
  }
}

RelativeUncertainty::RelativeUncertainty(const GraphModel& model, const std::vector<Tie>& ties) : model_(model) {
  number_retained();
  for (const Tie& tie : ties) {
    add(tie.a, tie.b, {between(model.poses[tie.a], model.poses[tie.b]), tie.covariance}, tie.loop);
  }
}

void RelativeUncertainty::number_retained() {
  slots_.resize(model_.submaps.size(), 0);
  for (std::uint32_t k = 0; k < model_.submaps.size(); ++k) {
    if (model_.submaps[k].condensed()) continue;
    slots_[k] = static_cast<std::uint32_t>(retained_.size());
    retained_.push_back(k);
  }
  edges_.resize(retained_.size());
}

void RelativeUncertainty::add(std::uint32_t a, std::uint32_t b, const UncertainPose& a_from_b, bool loop) {
  edges_[slots_[a]].push_back({slots_[b], a_from_b.covariance, loop});
  edges_[slots_[b]].push_back({slots_[a], inverse(a_from_b).covariance, loop});
}

const RelativePose& RelativeUncertainty::between_submaps(std::uint32_t a, std::uint32_t b) {
  auto found = known_.find(a);
  if (found == known_.end()) found = known_.emplace(a, paths_from(a)).first;
  return found->second[b];
}

RelativePoses RelativeUncertainty::paths_from(std::uint32_t start) const {
  using Entry = std::pair<double, std::uint32_t>;
  RelativePoses paths;
  paths.slots_ = &slots_;
  std::vector<RelativePose>& reached = paths.by_slot_;
  reached.resize(edges_.size());
  std::vector<double> best(edges_.size(), std::numeric_limits<double>::infinity());
  std::vector<bool> settled(edges_.size(), false);
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  reached[slots_[start]].reached = true;
  best[slots_[start]] = 0.0;
  open.emplace(0.0, slots_[start]);
  while (!open.empty()) {
    const std::uint32_t here = open.top().second;
    open.pop();
    if (settled[here]) continue;
    settled[here] = true;
    for (const Edge& edge : edges_[here]) {
      if (settled[edge.to]) continue;
      const UncertainPose step{between(model_.poses[retained_[here]], model_.poses[retained_[edge.to]]),
                               edge.covariance};
      UncertainPose to = compose(reached[here].pose, step);
      const double length = spread_m2(to.covariance);
      if (!(length < best[edge.to])) continue;
      best[edge.to] = length;
      to.mean.yaw = wrap_angle(to.mean.yaw);
      reached[edge.to] = {to, reached[here].through_loop || edge.loop, true};
      open.emplace(length, edge.to);
    }
  }
  return paths;
}

}  // namespace submapd::graph
