#include "slam/graph/internal/loop_policy.hpp"

#include <Eigen/LU>
#include <algorithm>

#include "slam/graph/internal/consistency.hpp"
#include "slam/graph/internal/live_graph.hpp"
#include "slam/graph/internal/loop_candidates.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"

namespace submapd::graph {
namespace {

constexpr int kPolicyRounds = 8;  // confirm and solve until nothing more follows
constexpr double kMinWeight = 0.25;
constexpr int kMaxDemotions = 2;         // a loop that lost its confirmation so often stays pending
constexpr std::size_t kMaxPending = 60;  // the newest so many take part in the search for cliques

// Chance of an accidental agreement that is let pass. Two loops alone must be surer than three, where two tests have to
// fail together.
constexpr double kChanceOfPair = 0.002;
constexpr double kChanceInClique = 0.05;
constexpr double kChanceAgainstGraph = 0.01;
constexpr double kChanceOfLone = 0.02;

// A lone loop has nothing else to vouch for it: what the match itself must show, and how tight the prediction must be.
constexpr double kLoneScore = 0.70;
constexpr double kLoneContradiction = 0.04;
constexpr double kLoneSigmaM = 1.0;
constexpr double kLoneSigmaRad = 5.0 * kDegree;

bool strong(const SubmapMatch& match, const GraphParts& parts) {
  return match.score >= kLoneScore && (match.contradiction <= kLoneContradiction || !parts.contradiction_test) &&
         !match.weak;
}

bool tight(const Eigen::Matrix3d& covariance) {
  return covariance(0, 0) + covariance(1, 1) < kLoneSigmaM * kLoneSigmaM &&
         covariance(2, 2) < kLoneSigmaRad * kLoneSigmaRad;
}

bool may_be_confirmed(const LoopRecord& record) {
  return record.loop.state == LoopState::kPending && record.demotions < kMaxDemotions;
}

Consistency against_graph(const GraphModel& model, const LoopRecord& record, const UncertainPose& predicted) {
  const UncertainPose measured = model.measured(record);
  const Pose2 off{measured.mean.x - predicted.mean.x, measured.mean.y - predicted.mean.y,
                  measured.mean.yaw - predicted.mean.yaw};
  return judge(off, measured.covariance + predicted.covariance, record.window);
}

// Rule (i): different pairs, not the same spot seen twice unless by the sub-map that came next.
bool independent(const GraphModel& model, const LoopRecord& p, const LoopRecord& q) {
  const auto place = [&](const LoopRecord& record) {
    return transform(model.poses[record.loop.match.b], record.place_in_b);
  };
  const std::uint32_t b_p = p.loop.match.b;
  const std::uint32_t b_q = q.loop.match.b;
  if (b_p + 1 == b_q || b_q + 1 == b_p) return true;
  return (place(p) - place(q)).norm() >= kApartM;
}

class Judge {
 public:
  Judge(const GraphModel& model, const std::vector<std::size_t>& members)
      : model_(model), members_(members), uncertainty_(model), table_(members.size()) {
    for (std::size_t i = 0; i < members.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) table_[i].push_back(pair(model.loops[members[i]], model.loops[members[j]]));
    }
  }

  // The largest clique of at least two members (positions in `members`) that no rival of equal size contradicts.
  std::vector<std::size_t> clique(const std::vector<bool>& excluded) const {
    std::vector<std::size_t> best = largest(excluded);
    if (best.size() < 2) return {};
    if (best.size() == 2 && !at(best[1], best[0]).agrees(kChanceOfPair)) return {};
    std::vector<bool> rest = excluded;
    for (const std::size_t k : best) rest[k] = true;
    const std::vector<std::size_t> rival = largest(rest);
    if (rival.size() < best.size()) return best;
    for (const std::size_t r : rival) {
      for (const std::size_t k : best) {
        if (at(std::max(r, k), std::min(r, k)).conflicts(kChanceInClique)) return {};
      }
    }
    return best;
  }

 private:
  Consistency pair(const LoopRecord& p, const LoopRecord& q) {
    const SubmapMatch& m = p.loop.match;
    const SubmapMatch& n = q.loop.match;
    // Of the two windows the smaller one: which of the loops might be the false one is not known.
    return judge_cycle(model_.measured(p), uncertainty_.between_submaps(m.a, n.a).pose, model_.measured(q),
                       uncertainty_.between_submaps(n.b, m.b).pose, p.window.cwiseMin(q.window));
  }
  const Consistency& at(std::size_t i, std::size_t j) const { return table_[i][j]; }

  std::vector<std::size_t> largest(const std::vector<bool>& excluded) const {
    std::vector<std::vector<bool>> agree(members_.size(), std::vector<bool>(members_.size(), false));
    for (std::size_t i = 0; i < members_.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        agree[i][j] = agree[j][i] = !excluded[i] && !excluded[j] && at(i, j).agrees(kChanceInClique) &&
                                    independent(model_, model_.loops[members_[i]], model_.loops[members_[j]]);
      }
    }
    return largest_clique(agree);
  }

  const GraphModel& model_;
  const std::vector<std::size_t>& members_;
  RelativeUncertainty uncertainty_;
  std::vector<std::vector<Consistency>> table_;  // lower triangle
};

}  // namespace

std::vector<std::size_t> confirm_loops(GraphModel& model, bool accept_lone) {
  std::vector<std::size_t> confirmed;
  std::vector<std::size_t> pending;
  std::vector<bool> contradicted;
  {
    RelativeUncertainty uncertainty(model);
    for (std::size_t k = 0; k < model.loops.size(); ++k) {
      const LoopRecord& record = model.loops[k];
      if (!may_be_confirmed(record)) continue;
      const SubmapMatch& match = record.loop.match;
      const RelativePose& predicted = uncertainty.between_submaps(match.a, match.b);
      const Consistency verdict = against_graph(model, record, predicted.pose);
      const bool vouched = predicted.through_loop && verdict.agrees(kChanceAgainstGraph);
      const bool alone = accept_lone && strong(match, model.parts) && tight(predicted.pose.covariance) &&
                         verdict.agrees(kChanceOfLone);
      const bool conflicts = verdict.mahalanobis2 > kChi2Conflict;
      if (vouched || alone || (!model.parts.pairwise_consistency && !conflicts)) {
        confirmed.push_back(k);
      } else {
        pending.push_back(k);
        contradicted.push_back(conflicts);
      }
    }
  }
  if (pending.size() > kMaxPending) {
    const auto surplus = static_cast<std::ptrdiff_t>(pending.size() - kMaxPending);
    pending.erase(pending.begin(), pending.begin() + surplus);
    contradicted.erase(contradicted.begin(), contradicted.begin() + surplus);
  }
  const Judge judge(model, pending);
  const std::vector<std::size_t> clique = judge.clique(contradicted);
  for (const std::size_t position : clique) confirmed.push_back(pending[position]);
  std::sort(confirmed.begin(), confirmed.end());
  for (const std::size_t k : confirmed) model.loops[k].loop.state = LoopState::kConfirmed;
  return confirmed;
}

double loop_weight(const GraphModel& model, const LoopRecord& record) {
  if (record.landmarks.empty()) return 0.0;
  const Pose2& a = model.poses[record.loop.match.a];
  const Pose2& b = model.poses[record.loop.match.b];
  std::vector<double> weights;
  for (const VirtualLandmark& landmark : record.landmarks) {
    const Eigen::Matrix2d R_a = rotation(a.yaw);
    const Eigen::Matrix2d R_b = rotation(b.yaw);
    const Eigen::Matrix2d covariance = R_a * live_covariance(landmark.covariance_a) * R_a.transpose() +
                                       R_b * live_covariance(landmark.covariance_b) * R_b.transpose();
    const Eigen::Vector2d e = transform(a, landmark.in_a) - transform(b, landmark.in_b);
    weights.push_back(1.0 / (1.0 + e.dot(covariance.inverse() * e)));
  }
  const auto middle = weights.begin() + static_cast<std::ptrdiff_t>(weights.size() / 2);
  std::nth_element(weights.begin(), middle, weights.end());
  return *middle;
}

int demote_loops(GraphModel& model) {
  int demoted = 0;
  for (LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed || record.loop.manual) continue;
    if (loop_weight(model, record) >= kMinWeight) continue;
    record.loop.state = LoopState::kPending;
    ++record.demotions;
    ++demoted;
  }
  return demoted;
}

Status settle_loops(GraphModel& model, bool accept_lone, bool solved,
                    const std::function<Status(const std::vector<std::size_t>& news)>& solve) {
  for (int round = 0; round < kPolicyRounds; ++round) {
    const auto news = confirm_loops(model, accept_lone);
    if (news.empty()) break;
    if (Status status = solve(news); !status.ok()) return status;
    solved = true;
    if (demote_loops(model) == 0) continue;
    if (Status status = solve({}); !status.ok()) return status;
  }
  return solved ? Status{} : solve({});
}

int reject_contradicted(GraphModel& model) {
  RelativeUncertainty uncertainty(model);
  int rejected = 0;
  for (LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kPending) continue;
    const RelativePose& predicted = uncertainty.between_submaps(record.loop.match.a, record.loop.match.b);
    if (!against_graph(model, record, predicted.pose).conflicts(kChanceInClique)) continue;
    record.loop.state = LoopState::kRejected;
    record.landmarks = {};
    ++rejected;
  }
  return rejected;
}

}  // namespace submapd::graph
