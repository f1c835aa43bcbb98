#include "slam/graph/optimizer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <memory>
#include <vector>

#include "slam/graph/internal/pair_tools.hpp"
#include "tests/unit/graph/simulated_run.hpp"

namespace submapd {
namespace {

using testing::revisit_rmse_m;
using testing::ring_path;
using testing::rmse_m;
using testing::SimulatedRun;
using testing::SimulatedRunOptions;

struct Outcome {
  std::vector<GraphState> states;  // after each sub-map
  FinalResult result;
  OptimizerCounters counters;
};

Outcome drive(SimulatedRun& run, const OptimizerOptions& options = {}) {
  Outcome outcome;
  Optimizer optimizer(options, run, run.tools());
  for (const auto& submap : run.submaps()) {
    auto state = optimizer.add_submap(submap);
    EXPECT_TRUE(state) << state.error().message();
    outcome.states.push_back(*state);
  }
  auto result = optimizer.finish();
  EXPECT_TRUE(result) << result.error().message();
  outcome.result = *result;
  outcome.counters = optimizer.counters();
  return outcome;
}

int count_confirmed(const SimulatedRun& run, const std::vector<Loop>& loops, bool true_ones) {
  int count = 0;
  for (const Loop& loop : loops) {
    if (loop.state == LoopState::kConfirmed && run.is_true(loop.match) == true_ones) ++count;
  }
  return count;
}

TEST(Optimizer, ClosesARingThatDrifted) {
  SimulatedRun run(ring_path(160.0, 2.0), {});
  OptimizerOptions without;
  without.loops = false;
  const Outcome open = drive(run, without);
  const Outcome closed = drive(run);
  std::printf("ring: RMSE %.3f m open, %.3f m live, %.3f m final (track points)\n%s", rmse_m(run, open.result.submaps),
              rmse_m(run, closed.states.back().submaps), rmse_m(run, closed.result.keyframes),
              closed.result.report.c_str());
  std::printf("slowest solve %.1f ms, peak %zu bytes\n", closed.counters.solve_ms_max, closed.counters.bytes_peak);
  EXPECT_EQ(count_confirmed(run, open.result.loops, true), 0);
  EXPECT_GT(rmse_m(run, open.result.submaps), 0.3);
  EXPECT_LT(rmse_m(run, closed.states.back().submaps), 0.3);
  EXPECT_LT(rmse_m(run, closed.result.keyframes), 0.3);
  EXPECT_LT(rmse_m(run, closed.result.keyframes), rmse_m(run, open.result.keyframes) / 2.0);
}

// The daemon saves a map with a sub-map that still grows. Loops found meanwhile stay known, the open sub-map does not.
TEST(Optimizer, FinishesWithAnOpenSubmapOnACopy) {
  SimulatedRun run(ring_path(160.0, 2.0), {});
  Optimizer optimizer({}, run, run.tools());
  std::vector<SubmapPose> live;
  for (const auto& submap : run.submaps()) {
    const std::uint64_t tried_before = optimizer.counters().loop_candidates;
    const auto saved = optimizer.finish_with(submap);
    ASSERT_TRUE(saved) << saved.error().message();
    EXPECT_EQ(saved->submaps.size(), submap->id.index + 1U);
    EXPECT_EQ(saved->keyframes.back().scan_index, submap->keyframes.back().scan_index);
    EXPECT_EQ(optimizer.counters().submaps, submap->id.index) << "the live graph does not have it";
    const std::uint64_t tried = optimizer.counters().loop_candidates;
    EXPECT_LE(tried - tried_before, 40U) << "somebody waits";
    ASSERT_TRUE(optimizer.finish_with(submap));
    EXPECT_EQ(optimizer.counters().loop_candidates, tried) << "the second of two maps seeks nothing again";
    const auto state = optimizer.add_submap(submap);
    ASSERT_TRUE(state) << state.error().message();
    live = state->submaps;
  }
  EXPECT_LT(rmse_m(run, live), 0.3);
  const auto whole = optimizer.finish();
  ASSERT_TRUE(whole) << whole.error().message();
  EXPECT_LT(rmse_m(run, whole->keyframes), 0.3);
  const auto wrong = optimizer.finish_with(run.submaps().front());
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().code(), StatusCode::kInvalidArgument) << "out of order";
}

TEST(Optimizer, ConfirmsNoFalseLoopAmongMany) {
  constexpr int kRuns = 20;
  int wrong = 0;
  int offered = 0;
  int right = 0;
  int right_offered = 0;
  double worst = 0.0;
  for (int seed = 1; seed <= kRuns; ++seed) {
    SimulatedRunOptions options;
    options.seed = static_cast<std::uint64_t>(seed);
    options.false_loops = 0.3;
    options.failures = 0.1;
    SimulatedRun run(ring_path(160.0, 1.7), options);
    const Outcome outcome = drive(run);
    for (const GraphState& state : outcome.states) wrong += count_confirmed(run, state.loops, false);
    wrong += count_confirmed(run, outcome.result.loops, false);
    right += count_confirmed(run, outcome.result.loops, true);
    for (const Loop& loop : outcome.result.loops) ++(run.is_true(loop.match) ? right_offered : offered);
    worst = std::max(worst, revisit_rmse_m(run, outcome.result.keyframes));
  }
  std::printf(
      "%d runs: false loops %d offered, %d confirmed at some time; true %d of %d confirmed; worst revisit RMSE %.3f "
      "m\n",
      kRuns, offered, wrong, right, right_offered, worst);
  EXPECT_GT(offered, 5 * kRuns);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(right, right_offered * 9 / 10);
  EXPECT_LT(worst, 0.15);
}

Outcome drive_without(SimulatedRun& run, bool GraphParts::*part) {
  OptimizerOptions options;
  options.parts.*part = false;
  return drive(run, options);
}

TEST(Optimizer, WithoutPairwiseConsistencyFalseLoopsAreConfirmed) {
  int with = 0;
  int without = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SimulatedRunOptions options;
    options.seed = seed;
    options.false_loops = 0.7;
    SimulatedRun run(ring_path(160.0, 1.7), options);
    for (const GraphState& state : drive(run).states) with += count_confirmed(run, state.loops, false);
    for (const GraphState& state : drive_without(run, &GraphParts::pairwise_consistency).states) {
      without += count_confirmed(run, state.loops, false);
    }
  }
  std::printf("false loops confirmed: %d, without pairwise consistency %d\n", with, without);
  EXPECT_EQ(with, 0);
  EXPECT_GT(without, 0);
}

TEST(Optimizer, LandmarkRowsAndRobustLossCanBeSwitchedOff) {
  SimulatedRun run(ring_path(160.0, 1.7), {});
  const Outcome whole = drive(run);
  const Outcome edges = drive_without(run, &GraphParts::landmark_rows);
  EXPECT_LT(edges.result.graph.point_edges.size(), whole.result.graph.point_edges.size());
  EXPECT_GT(edges.result.graph.pose_edges.size(), whole.result.graph.pose_edges.size());
  EXPECT_LT(revisit_rmse_m(run, edges.result.keyframes), 0.15);
  const Outcome plain = drive_without(run, &GraphParts::robust_loss);
  EXPECT_EQ(plain.states.back().submaps.back().map_from_submap, whole.states.back().submaps.back().map_from_submap)
      << "the live graph is the same";
  EXPECT_NE(plain.result.submaps.back().map_from_submap, whole.result.submaps.back().map_from_submap);
}

TEST(Optimizer, RevisitsAfterSomeMetresOfDriftAreAllTied) {
  SimulatedRunOptions options;
  options.seed = 4;
  SimulatedRun run(testing::corridor_path(80.0), options);
  const Outcome outcome = drive(run);
  int overlapping = 0;
  for (const Loop& loop : outcome.result.loops) overlapping += run.is_true(loop.match) ? 1 : 0;
  std::printf("there and back: %d matched rightly, %d confirmed; %s", overlapping,
              count_confirmed(run, outcome.result.loops, true), outcome.result.report.c_str());
  EXPECT_GT(overlapping, 10);
  EXPECT_GE(count_confirmed(run, outcome.result.loops, true), overlapping * 95 / 100);
  EXPECT_LT(revisit_rmse_m(run, outcome.result.keyframes), 0.06);
  EXPECT_LT(rmse_m(run, outcome.result.keyframes), 0.6);
}

TEST(Optimizer, SameInputSameBits) {
  SimulatedRunOptions options;
  options.false_loops = 0.2;
  SimulatedRun first(ring_path(120.0, 1.6), options);
  SimulatedRun second(ring_path(120.0, 1.6), options);
  const Outcome a = drive(first);
  const Outcome b = drive(second);
  ASSERT_EQ(a.result.keyframes.size(), b.result.keyframes.size());
  for (std::size_t k = 0; k < a.result.keyframes.size(); ++k) {
    ASSERT_EQ(a.result.keyframes[k].map_from_base, b.result.keyframes[k].map_from_base) << k;
  }
  ASSERT_EQ(a.states.size(), b.states.size());
  for (std::size_t k = 0; k < a.states.size(); ++k) {
    ASSERT_EQ(a.states[k].version, b.states[k].version);
    for (std::size_t j = 0; j < a.states[k].submaps.size(); ++j) {
      ASSERT_EQ(a.states[k].submaps[j].map_from_submap, b.states[k].submaps[j].map_from_submap);
    }
  }
  EXPECT_EQ(a.result.report, b.result.report);
}

TEST(Optimizer, LoopsPullABrokenPieceIntoPlace) {
  SimulatedRunOptions options;
  options.breaks = {12};
  SimulatedRun run(ring_path(120.0, 2.0), options);
  // Odometry after the break is a metre and six degrees off.
  PairTools tools = run.tools();
  Optimizer optimizer({}, run, tools);
  for (const auto& submap : run.submaps()) {
    auto shifted = std::make_shared<FinishedSubmap>(*submap);
    if (submap->id.index >= 12) shifted->odom_from_submap = compose({1.0, -0.5, 0.1}, submap->odom_from_submap);
    ASSERT_TRUE(optimizer.add_submap(shifted));
  }
  const auto result = optimizer.finish();
  ASSERT_TRUE(result) << result.error().message();
  std::printf("break: RMSE %.3f m\n%s", rmse_m(run, result->keyframes), result->report.c_str());
  EXPECT_LT(rmse_m(run, result->keyframes), 0.4);
}

TEST(Optimizer, FullBudgetRefusesLandmarksAndGoesOn) {
  SimulatedRun run(ring_path(120.0, 2.0), {});
  const std::size_t unbounded = drive(run).counters.bytes_peak;
  OptimizerOptions options;
  options.graph_bytes_limit = unbounded * 7 / 10;
  const Outcome outcome = drive(run, options);
  // Sub-maps' own records are always kept: mapping goes on.
  EXPECT_LT(outcome.counters.bytes_peak, unbounded);
  EXPECT_GT(outcome.counters.refused_for_memory, 0U);
  EXPECT_EQ(outcome.result.submaps.size(), run.submaps().size());
}

TEST(Optimizer, RefusesWhatItCannotUse) {
  SimulatedRun run(ring_path(120.0, 0.5), {});
  Optimizer optimizer({}, run, run.tools());
  EXPECT_FALSE(optimizer.finish());
  EXPECT_EQ(optimizer.add_submap(nullptr).error().code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(optimizer.add_submap(run.submaps()[1]).error().code(), StatusCode::kInvalidArgument);
  auto empty = std::make_shared<FinishedSubmap>(*run.submaps()[0]);
  empty->keyframes.clear();
  EXPECT_FALSE(optimizer.add_submap(empty));
  auto nan = std::make_shared<FinishedSubmap>(*run.submaps()[0]);
  nan->keyframes[3].pose.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(optimizer.add_submap(nan));
  // A covariance that is no number costs its edge, not the run.
  auto doubtful = std::make_shared<FinishedSubmap>(*run.submaps()[0]);
  doubtful->keyframes[3].step_covariance(0, 0) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(optimizer.add_submap(doubtful));
  EXPECT_TRUE(optimizer.add_submap(run.submaps()[1]));
  EXPECT_TRUE(optimizer.finish());
}

TEST(Optimizer, CountsWhatItHolds) {
  SimulatedRun run(ring_path(120.0, 1.5), {});
  const Outcome outcome = drive(run);
  const OptimizerCounters& counted = outcome.counters;
  EXPECT_EQ(counted.submaps, run.submaps().size());
  EXPECT_GE(counted.solves, run.submaps().size() + 1);
  EXPECT_EQ(counted.loops_confirmed + counted.loops_pending, outcome.result.loops.size());
  EXPECT_GE(counted.loop_candidates, outcome.result.loops.size());
  EXPECT_EQ(counted.landmarks, outcome.result.graph.points.size());
  EXPECT_GE(counted.bytes_peak, counted.bytes_used);
  for (std::size_t k = 1; k < outcome.states.size(); ++k) {
    EXPECT_GT(outcome.states[k].version, outcome.states[k - 1].version);
    // The first sub-map is the gauge.
    EXPECT_EQ(outcome.states[k].submaps[0].map_from_submap, outcome.states[0].submaps[0].map_from_submap);
  }
}

TEST(Optimizer, WhatIsCancelledEndsBeforeItSolves) {
  SimulatedRun run(ring_path(60.0, 2.0), {});
  Optimizer* worked_on = nullptr;
  PairTools tools = run.tools();
  tools.refine = [&worked_on, refine = tools.refine](const SubmapView& a, const SubmapView& b, const Pose2& start) {
    worked_on->cancel();  // another thread, while it works
    return refine(a, b, start);
  };
  Optimizer optimizer({}, run, tools);
  worked_on = &optimizer;
  ASSERT_TRUE(optimizer.add_submap(run.submaps()[0]));
  const auto added = optimizer.add_submap(run.submaps()[1]);
  ASSERT_FALSE(added);
  EXPECT_EQ(added.error().code(), StatusCode::kUnavailable);

  OptimizerOptions without_loops;
  without_loops.loops = false;
  Optimizer last(without_loops, run, run.tools());
  ASSERT_TRUE(last.add_submap(run.submaps()[0]));
  ASSERT_TRUE(last.add_submap(run.submaps()[1]));
  last.cancel();
  const auto finished = last.finish();
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().code(), StatusCode::kUnavailable);
}

}  // namespace
}  // namespace submapd
