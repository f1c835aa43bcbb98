#include "slam/graph/optimizer.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "tests/unit/graph/simulated_run.hpp"

namespace submapd {
namespace {

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

TEST(Optimizer, ConfirmsNoFalseLoopAmongMany) {
  constexpr int kRuns = 40;
  int wrong = 0;
  int offered = 0;
  int right = 0;
  int right_offered = 0;
  double worst = 0.0;
  for (int seed = 1; seed <= kRuns; ++seed) {
    SimulatedRunOptions options;
    options.seed = static_cast<std::uint64_t>(seed);
    options.step_sigma_rad *= 2.0;
    options.false_loops = 0.3;
    options.failures = 0.1;
    SimulatedRun run(ring_path(200.0, 2.0), options);
    const Outcome outcome = drive(run);
    for (const GraphState& state : outcome.states) wrong += count_confirmed(run, state.loops, false);
    wrong += count_confirmed(run, outcome.result.loops, false);
    right += count_confirmed(run, outcome.result.loops, true);
    for (const Loop& loop : outcome.result.loops) ++(run.is_true(loop.match) ? right_offered : offered);
    worst = std::max(worst, rmse_m(run, outcome.result.keyframes));
  }
  std::printf(
      "%d runs: false loops %d offered, %d confirmed at some time; true %d of %d confirmed; worst RMSE %.3f m\n", kRuns,
      offered, wrong, right, right_offered, worst);
  EXPECT_GT(offered, 5 * kRuns);
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(right, right_offered * 9 / 10);
  EXPECT_LT(worst, 0.5);
}

}  // namespace
}  // namespace submapd
