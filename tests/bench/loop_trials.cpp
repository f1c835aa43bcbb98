#include "tests/bench/loop_trials.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "slam/base/random.hpp"
#include "slam/base/small_matrix.hpp"
#include "slam/graph/internal/live_graph.hpp"
#include "slam/graph/internal/loop_candidates.hpp"
#include "slam/graph/internal/loop_policy.hpp"
#include "slam/graph/internal/loop_search.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"

namespace submapd::bench {
namespace {

using graph::kDegree;

constexpr double kOverlap_m2 = 25.0;
constexpr double kMinStructure = 0.06;  // where the filter takes a direction as observed again (notes 5.4)
constexpr int kMostMultiples = 2;
constexpr int kAttempts = 300;

// Standard deviations from 0.2 m and 2 deg to 3 m and 12 deg, even in their logarithms.
constexpr double kLeastSigma_m = 0.2;
constexpr double kSigmaRange = 15.0;
constexpr double kLeastSigma_deg = 2.0;
constexpr double kSigmaRange_deg = 6.0;

// Places in a trial's graph.
constexpr std::uint32_t kA = 1;
constexpr std::uint32_t kB = 2;
constexpr std::uint32_t kMembers = 4;

std::uint32_t of_run(const Trial& trial, std::uint32_t member) {
  return member <= kA ? trial.a - kA + member : trial.b + member - kB;
}

// The trial's four sub-maps under their numbers in its graph.
class Members : public SubmapSource {
 public:
  Members(const TrialRun& run, const Trial& trial) {
    for (std::uint32_t member = 0; member < kMembers; ++member) {
      auto submap = std::make_shared<FinishedSubmap>(*run.submaps[of_run(trial, member)]);
      submap->id.index = member;
      submaps_[member] = std::move(submap);
    }
  }
  Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) override { return submaps_[index]; }

 private:
  std::array<std::shared_ptr<const FinishedSubmap>, kMembers> submaps_;
};

Pose2 moved(const Pose2& pose, const Eigen::Vector2d& by) {
  return {pose.x + by.x(), pose.y + by.y(), pose.yaw};
}

// All sums of the translations, each up to so many times to and fro, but for nothing at all.
std::vector<Eigen::Vector2d> sums_of(const std::vector<Eigen::Vector2d>& aliases) {
  std::vector<Eigen::Vector2d> sums = {Eigen::Vector2d::Zero()};
  for (const Eigen::Vector2d& alias : aliases) {
    const std::size_t before = sums.size();
    for (int k = 1; k <= kMostMultiples; ++k) {
      for (std::size_t i = 0; i < before; ++i) {
        sums.emplace_back(sums[i] + k * alias);
        sums.emplace_back(sums[i] - k * alias);
      }
    }
  }
  sums.erase(sums.begin());
  return sums;
}

// Standard normal within three sigma, where the search window ends.
double within_window(CounterRandom& random) {
  for (;;) {
    const double z = random.gaussian();
    if (std::abs(z) <= 3.0) return z;
  }
}

}  // namespace

bool is_false(const Pose2& true_a_from_b, const Pose2& a_from_b) {
  const Pose2 off = between(true_a_from_b, a_from_b);
  return off.translation().norm() > kFalse_m || std::abs(off.yaw) > kFalse_rad;
}

double structure_of(const FinishedSubmap& b, const SubmapOutline& a, const Pose2& a_from_b) {
  const auto by_row = [](const std::array<std::int16_t, 2>& p, const std::array<std::int16_t, 2>& q) {
    return std::pair(p[1], p[0]) < std::pair(q[1], q[0]);
  };
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  for (const SurfacePoint& point : b.surface) {
    const Eigen::Vector2d place = transform(a_from_b, {point.x, point.y}) / a.coarse_cell_m;
    const std::array<std::int16_t, 2> cell = {static_cast<std::int16_t>(std::floor(place.x())),
                                              static_cast<std::int16_t>(std::floor(place.y()))};
    if (!std::binary_search(a.known.begin(), a.known.end(), cell, by_row)) continue;
    const Eigen::Vector2d normal(point.normal_x, point.normal_y);
    sum += normal * normal.transpose();
  }
  const Eigen::Vector2d values = principal_axes(sum).values;
  return values[1] > 0.0 ? values[0] / values[1] : 0.0;
}

bool alias_in_window(const std::vector<Eigen::Vector2d>& aliases, const Pose2& world_from_a, const Pose2& world_from_b,
                     const MatchPrior& prior) {
  const Eigen::Vector3d window = graph::search_window(prior.covariance);
  const auto sums = sums_of(aliases);
  return std::any_of(sums.begin(), sums.end(), [&](const Eigen::Vector2d& sum) {
    const Pose2 as_b = between(world_from_a, moved(world_from_b, sum));
    return std::abs(as_b.x - prior.a_from_b.x) <= window.x() && std::abs(as_b.y - prior.a_from_b.y) <= window.y() &&
           std::abs(wrap_angle(as_b.yaw - prior.a_from_b.yaw)) <= window.z();
  });
}

TrialGround::TrialGround(TrialRun run, TrialOptions options) : run_(std::move(run)), options_(std::move(options)) {
  for (const auto& submap : run_.submaps) {
    records_.push_back(graph::make_record(*submap, tools_.make_outline(*submap)));
    links_.push_back(records_.size() == 1 ? graph::ChainLink{}
                                          : graph::make_link(records_[records_.size() - 2], records_.back(),
                                                             submap->linked_to_previous));
  }
  const auto count = static_cast<std::uint32_t>(records_.size());
  for (std::uint32_t a = 1; a < count; ++a) {
    for (std::uint32_t b = a + 1; b + 1 < count; ++b) {
      // Stretches that hang together in themselves, and hold no scan in common.
      if (links_[a].linked && links_[b + 1].linked && !graph::share_keyframes(records_[a], records_[b])) {
        sort_pair(a, b);
      }
    }
  }
}

void TrialGround::sort_pair(std::uint32_t a, std::uint32_t b) {
  const SubmapOutline& outline_a = *records_[a].outline;
  const SubmapOutline& outline_b = *records_[b].outline;
  const Pose2& world_from_a = run_.world_from_submap[a];
  const Pose2& world_from_b = run_.world_from_submap[b];
  const Pose2 a_from_b = between(world_from_a, world_from_b);
  const double overlap_m2 = tools_.overlap_m2(outline_a, outline_b, a_from_b, 0.0);
  const auto list = [this](TrialKind kind) -> std::vector<Pair>& { return pairs_[static_cast<std::size_t>(kind)]; };
  if (overlap_m2 >= kOverlap_m2) {
    list(TrialKind::kOverlapping).push_back({a, b, a_from_b, overlap_m2});
    return;
  }
  list(TrialKind::kApart).push_back({a, b, a_from_b, overlap_m2});
  for (const Eigen::Vector2d& sum : sums_of(options_.aliases)) {
    const Pose2 as_b = between(world_from_a, moved(world_from_b, sum));
    if (tools_.overlap_m2(outline_a, outline_b, as_b, 0.0) < kOverlap_m2) continue;
    list(TrialKind::kDeceived).push_back({a, b, as_b, overlap_m2});
  }
}

graph::GraphModel TrialGround::graph_of(std::uint32_t a, std::uint32_t b, const MatchPrior& prior) const {
  graph::GraphModel model;
  graph::ChainLink joint;
  joint.edge = {prior.a_from_b, prior.covariance};
  model.submaps = {records_[a - 1], records_[a], records_[b], records_[b + 1]};
  model.links = {{}, links_[a], joint, links_[b + 1]};
  model.poses = {Pose2{}};
  for (std::uint32_t k = 1; k < kMembers; ++k) {
    model.poses.push_back(compose(model.poses.back(), model.links[k].edge.mean));
  }
  return model;
}

bool TrialGround::is_asked(std::uint32_t a, std::uint32_t b, const MatchPrior& prior) const {
  const graph::GraphModel model = graph_of(a, b, prior);
  const graph::RelativeUncertainty uncertainty(model);
  return !graph::rank_candidates(model, tools_, uncertainty, kB, 1, [](std::uint32_t other, const Pose2&) {
            return other != kA;
          }).empty();
}

std::optional<Trial> TrialGround::draw(TrialKind kind, std::uint64_t number) const {
  const std::vector<Pair>& pairs = pairs_[static_cast<std::size_t>(kind)];
  if (pairs.empty()) return std::nullopt;
  CounterRandom random(options_.seed, run_.number, number);
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    const Pair& pair = pairs[random.next_u64() % pairs.size()];
    const double share = random.uniform();
    Trial trial;
    trial.kind = kind;
    trial.a = pair.a;
    trial.b = pair.b;
    trial.sigma_m = kLeastSigma_m * std::pow(kSigmaRange, share);
    trial.sigma_rad = kLeastSigma_deg * kDegree * std::pow(kSigmaRange_deg, share);
    trial.prior.covariance = graph::pose_covariance(trial.sigma_m, trial.sigma_rad);
    trial.prior.a_from_b = {pair.seen_at.x + trial.sigma_m * within_window(random),
                            pair.seen_at.y + trial.sigma_m * within_window(random),
                            wrap_angle(pair.seen_at.yaw + trial.sigma_rad * within_window(random))};
    if (!is_asked(trial.a, trial.b, trial.prior)) continue;
    const Pose2& world_from_a = run_.world_from_submap[trial.a];
    const Pose2& world_from_b = run_.world_from_submap[trial.b];
    trial.a_from_b = between(world_from_a, world_from_b);
    trial.overlap_m2 = pair.overlap_m2;
    trial.structure = structure_of(*run_.submaps[trial.b], *records_[trial.a].outline, trial.a_from_b);
    trial.unambiguous = kind == TrialKind::kOverlapping && trial.structure >= kMinStructure &&
                        !alias_in_window(options_.aliases, world_from_a, world_from_b, trial.prior);
    return trial;
  }
  return std::nullopt;
}

TrialResult TrialGround::run(const Trial& trial) const {
  TrialResult result;
  Members members(run_, trial);
  PairTools watched = tools_;
  watched.search = [&](const SubmapView& a, const SubmapView& b, const MatchPrior& prior) {
    SubmapMatch match = tools_.search(a, b, prior);
    if (a.submap.id.index == kA && b.submap.id.index == kB) result.match = match;
    return match;
  };
  graph::LoopSearch search(watched, members);
  constexpr std::size_t kRoom = std::numeric_limits<std::size_t>::max();

  // Grown sub-map by sub-map, as the optimizer does, so that neighbours are tied.
  const graph::GraphModel whole = graph_of(trial.a, trial.b, trial.prior);
  graph::GraphModel model;
  for (std::uint32_t k = 0; k < kMembers; ++k) {
    model.submaps.push_back(whole.submaps[k]);
    model.links.push_back(whole.links[k]);
    model.poses.push_back(whole.poses[k]);
    if (!model.links[k].linked) continue;
    const auto newest = members.load(k);
    model.links[k].landmarks = search.tie_neighbours(model, *newest, kRoom);
  }
  std::vector<graph::LoopCandidate> candidates;
  const graph::RelativeUncertainty uncertainty(model);
  for (std::uint32_t b = kB; b < kMembers; ++b) {
    for (const graph::LoopCandidate& candidate : search.untried(model, uncertainty, b, 1)) {
      if (candidate.a <= kA) candidates.push_back(candidate);
    }
  }
  for (const graph::LoopCandidate& candidate : candidates) search.run(model, candidate, kRoom);
  const Pose2 off = between(trial.a_from_b, result.match.a_from_b);
  result.off_m = off.translation().norm();
  result.off_rad = std::abs(off.yaw);
  result.accepted = result.match.verdict == MatchVerdict::kAccepted;

  // A failed solve keeps the poses, here as in the optimizer.
  (void)graph::settle_loops(model, true, false, [&](const std::vector<std::size_t>& news) {
    const auto summary = graph::solve_live(model, news);
    return summary ? Status{} : summary.error();
  });
  for (const graph::LoopRecord& record : model.loops) {
    if (record.loop.state != LoopState::kConfirmed) continue;
    const SubmapMatch& match = record.loop.match;
    ++result.loops_confirmed;
    result.confirmed = result.confirmed || (match.a == kA && match.b == kB);
    const std::uint32_t a = of_run(trial, match.a);
    const std::uint32_t b = of_run(trial, match.b);
    const Pose2 true_a_from_b = between(run_.world_from_submap[a], run_.world_from_submap[b]);
    if (!is_false(true_a_from_b, match.a_from_b)) continue;
    const Pose2 wrong = between(true_a_from_b, match.a_from_b);
    result.wrong_confirmed.push_back({a, b, wrong.translation().norm(), std::abs(wrong.yaw)});
  }
  return result;
}

}  // namespace submapd::bench
