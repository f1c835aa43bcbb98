// The graph under a budget: sub-maps are condensed, what stays does not move, and nothing falls off.
#include "slam/graph/internal/condensation.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>
#include <vector>

#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/optimizer.hpp"
#include "tests/unit/graph/simulated_run.hpp"

namespace submapd {
namespace {

using testing::revisit_rmse_m;
using testing::ring_path;
using testing::SimulatedRun;
using testing::SimulatedRunOptions;

constexpr std::size_t kSmall = 400'000;  // bytes: some 25 sub-maps with their loops

struct Outcome {
  std::vector<GraphState> states;
  std::vector<OptimizerCounters> counters;
  FinalResult result;
};

Outcome drive(SimulatedRun& run, std::size_t graph_bytes, const GraphParts& parts = {}) {
  Outcome outcome;
  Optimizer optimizer({.parts = parts, .graph_bytes_limit = graph_bytes}, run, run.tools());
  for (const auto& submap : run.submaps()) {
    auto state = optimizer.add_submap(submap);
    EXPECT_TRUE(state) << state.error().message();
    outcome.states.push_back(std::move(*state));
    outcome.counters.push_back(optimizer.counters());
  }
  auto result = optimizer.finish();
  EXPECT_TRUE(result) << result.error().message();
  outcome.result = std::move(*result);
  return outcome;
}

double farthest_m(const std::vector<SubmapPose>& p, const std::vector<SubmapPose>& q) {
  double farthest = 0.0;
  for (std::size_t k = 0; k < std::min(p.size(), q.size()); ++k) {
    farthest = std::max(farthest, (p[k].map_from_submap.translation() - q[k].map_from_submap.translation()).norm());
  }
  return farthest;
}

// Every vertex hangs together with the first by edges between vertices that exist.
void expect_one_piece(const GraphExport& graph) {
  std::map<std::uint64_t, std::uint64_t> parent;
  for (const GraphPose& pose : graph.poses) EXPECT_TRUE(parent.emplace(pose.id, pose.id).second) << "twice " << pose.id;
  const auto root = [&](std::uint64_t id) {
    while (parent.at(id) != id) id = parent.at(id);
    return id;
  };
  for (const GraphPoint& point : graph.points) EXPECT_TRUE(parent.emplace(point.id, point.id).second);
  const auto join = [&](const auto& edge) {
    ASSERT_TRUE(parent.contains(edge.from) && parent.contains(edge.to));
    parent[root(edge.from)] = root(edge.to);
  };
  for (const GraphPoseEdge& edge : graph.pose_edges) join(edge);
  for (const GraphPointEdge& edge : graph.point_edges) join(edge);
  for (const GraphPose& pose : graph.poses) EXPECT_EQ(root(pose.id), root(graph.poses.front().id)) << pose.id;
}

TEST(Condensation, HoldsTheBudgetInKnownSpaceAtTheSameError) {
  SimulatedRun run(ring_path(80.0, 7.0), {});
  const Outcome whole = drive(run, 1U << 30);
  const Outcome small = drive(run, kSmall);
  const OptimizerCounters& last = small.counters.back();
  const double whole_m = revisit_rmse_m(run, whole.result.keyframes);
  const double small_m = revisit_rmse_m(run, small.result.keyframes);
  std::printf(
      "%llu sub-maps: %llu condensed, %llu frozen; %zu bytes, %zu without a limit; %zu track points, %zu; revisit "
      "RMSE %.4f m, %.4f m; %llu loops, %llu\n",
      static_cast<unsigned long long>(last.submaps), static_cast<unsigned long long>(last.submaps_condensed),
      static_cast<unsigned long long>(last.submaps_frozen), last.bytes_used, whole.counters.back().bytes_used,
      small.result.keyframes.size(), whole.result.keyframes.size(), small_m, whole_m,
      static_cast<unsigned long long>(last.loops_confirmed),
      static_cast<unsigned long long>(whole.counters.back().loops_confirmed));
  EXPECT_GT(whole.counters.back().bytes_used, 2 * kSmall);
  EXPECT_EQ(whole.counters.back().submaps_condensed, 0U);
  for (const OptimizerCounters& counted : small.counters) EXPECT_LE(counted.bytes_used, kSmall);
  EXPECT_GT(last.submaps_condensed, run.submaps().size() / 2);
  EXPECT_EQ(last.submaps_frozen, 0U) << "all of it is known space";
  EXPECT_EQ(last.refused_for_memory, 0U);
  EXPECT_LE(small_m, std::max(1.2 * whole_m, 0.02));
  EXPECT_EQ(small.result.submaps.size(), run.submaps().size());
  EXPECT_EQ(small.states.back().submaps.size(), run.submaps().size());
  EXPECT_EQ(small.result.submaps.front().state, SubmapState::kRetained) << "the gauge";
  expect_one_piece(small.result.graph);
  std::set<std::uint64_t> keyframes;
  for (const OptimizedKeyframe& keyframe : small.result.keyframes) {
    EXPECT_TRUE(keyframes.empty() || keyframe.scan_index > *keyframes.rbegin()) << "in order, each once";
    keyframes.insert(keyframe.scan_index);
  }
  for (const auto& submap : run.submaps()) {
    EXPECT_TRUE(keyframes.contains(submap->keyframes.front().scan_index) ||
                keyframes.contains(submap->keyframes[submap->keyframes.size() / 2].scan_index));
  }
}

TEST(Condensation, LoopsThatAreOneEdgeHoldAsWell) {
  SimulatedRun run(ring_path(80.0, 4.0), {});
  const Outcome edges = drive(run, kSmall, {.landmark_rows = false});
  EXPECT_GT(edges.counters.back().submaps_condensed, 0U);
  EXPECT_LT(revisit_rmse_m(run, edges.result.keyframes), 0.05);
  expect_one_piece(edges.result.graph);
}

// What is condensed stays where the graph last had it, and the retained ones barely feel it.
TEST(Condensation, MovesNothing) {
  SimulatedRunOptions options;
  options.step_sigma_m = 0.0005;
  options.step_sigma_rad = 0.0001;
  options.match_noise = 0.1;
  SimulatedRun run(ring_path(80.0, 5.0), options);
  const Outcome small = drive(run, kSmall);
  EXPECT_GT(small.counters.back().submaps_condensed, 0U);
  for (std::size_t k = 1; k < small.states.size(); ++k) {
    if (small.counters[k].submaps_condensed == small.counters[k - 1].submaps_condensed) continue;
    // The next sub-map's solve is the first without the condensed ones.
    if (k + 1 == small.states.size()) break;
    EXPECT_LT(farthest_m(small.states[k].submaps, small.states[k + 1].submaps), 0.015) << k;
  }
}

// A building that is larger than the budget: the oldest part is frozen, mapping goes on, and the chain is whole.
TEST(Condensation, FreezesTheOldestWhereNothingIsKnownTwice) {
  SimulatedRun run(ring_path(500.0, 0.9), {});
  const Outcome small = drive(run, 150'000);
  const OptimizerCounters& last = small.counters.back();
  std::printf("%llu sub-maps: %llu condensed, %llu frozen, %zu bytes\n", static_cast<unsigned long long>(last.submaps),
              static_cast<unsigned long long>(last.submaps_condensed),
              static_cast<unsigned long long>(last.submaps_frozen), last.bytes_used);
  for (const OptimizerCounters& counted : small.counters) EXPECT_LE(counted.bytes_used, 150'000U);
  EXPECT_GT(last.submaps_frozen, 10U);
  ASSERT_EQ(small.result.submaps.size(), run.submaps().size());
  for (std::size_t k = 1; k < run.submaps().size(); ++k) {
    const Pose2 tracked = between(run.submaps()[k - 1]->odom_from_submap, run.submaps()[k]->odom_from_submap);
    const Pose2 found = between(small.result.submaps[k - 1].map_from_submap, small.result.submaps[k].map_from_submap);
    EXPECT_LT((found.translation() - tracked.translation()).norm(), 0.1) << k;
  }
  for (std::size_t k = 1; k < small.result.bounds.size(); ++k) {
    EXPECT_GE(small.result.bounds[k].covariance(2, 2), 0.0);
    EXPECT_GT(small.result.bounds[k].begun_us, small.result.bounds[k - 1].begun_us);
  }
  expect_one_piece(small.result.graph);
}

// A resumed run computes its graph again from its sub-maps.
TEST(Condensation, SameSubmapsSameBits) {
  SimulatedRun run(ring_path(80.0, 4.0), {});
  const Outcome once = drive(run, kSmall);
  const Outcome again = drive(run, kSmall);
  ASSERT_GT(once.counters.back().submaps_condensed, 0U);
  ASSERT_EQ(once.result.keyframes.size(), again.result.keyframes.size());
  for (std::size_t k = 0; k < once.result.keyframes.size(); ++k) {
    ASSERT_EQ(once.result.keyframes[k].map_from_base, again.result.keyframes[k].map_from_base) << k;
  }
  for (std::size_t k = 0; k < once.result.submaps.size(); ++k) {
    ASSERT_EQ(once.result.submaps[k].map_from_submap, again.result.submaps[k].map_from_submap) << k;
    ASSERT_EQ(once.result.submaps[k].state, again.result.submaps[k].state) << k;
  }
  EXPECT_EQ(once.result.report, again.result.report);
}

// Saving a map works on a copy: what is condensed stays so, and the open sub-map is the newest.
TEST(Condensation, MapsAreSavedMeanwhile) {
  SimulatedRun run(ring_path(80.0, 4.0), {});
  Optimizer optimizer({.graph_bytes_limit = kSmall}, run, run.tools());
  for (const auto& submap : run.submaps()) {
    if (submap->id.index % 8 == 7) {
      const auto saved = optimizer.finish_with(submap);
      ASSERT_TRUE(saved) << saved.error().message();
      EXPECT_EQ(saved->submaps.size(), submap->id.index + 1U);
      EXPECT_EQ(saved->keyframes.back().scan_index, submap->keyframes.back().scan_index);
      EXPECT_LT(revisit_rmse_m(run, saved->keyframes), 0.15);
    }
    ASSERT_TRUE(optimizer.add_submap(submap));
  }
  EXPECT_GT(optimizer.counters().submaps_condensed, 0U);
}

}  // namespace
}  // namespace submapd
