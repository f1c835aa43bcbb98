// A person's ties: the closed form, and what they do to a graph that the loops cannot mend.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/point_pairs.hpp"
#include "tests/unit/graph/simulated_run.hpp"

namespace submapd {
namespace {

using testing::ring_path;
using testing::rmse_m;
using testing::SimulatedRun;

std::vector<TiePoint> points_at(const Pose2& a_from_b, const std::vector<Eigen::Vector2d>& in_b) {
  std::vector<TiePoint> points;
  for (const Eigen::Vector2d& p : in_b) points.push_back({transform(a_from_b, p), p});
  return points;
}

RC_GTEST_PROP(PointPairs, TheClosedFormFindsThePoseThatMadeThePairs, ()) {
  const auto metres = [] { return 0.01 * *rc::gen::inRange(-5000, 5000); };
  const Pose2 truth{metres(), metres(), 0.001 * *rc::gen::inRange(-3141, 3141)};
  std::vector<Eigen::Vector2d> spots{{metres(), metres()}};
  spots.push_back(spots.front() + Eigen::Vector2d(1.5, 0.0));
  for (int more = *rc::gen::inRange(0, 5); more > 0; --more) spots.emplace_back(metres(), metres());
  const auto found = relative_pose_of(points_at(truth, spots), 0.1);
  RC_ASSERT(found.has_value());
  const Pose2 off = between(truth, found->a_from_b);
  RC_ASSERT(off.translation().norm() < 1e-9);
  RC_ASSERT(std::abs(wrap_angle(off.yaw)) < 1e-9);
  for (const double residual : found->residual_m) RC_ASSERT(residual < 1e-9);
}

TEST(PointPairs, TheCovarianceIsThatOfTheSpots) {
  // Two spots 10 m apart about b's origin: the origin is known as the mean of both, the heading by the base line.
  const auto found = relative_pose_of(points_at({3.0, 4.0, 0.5}, {{-5.0, 0.0}, {5.0, 0.0}}), 0.1);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->covariance(0, 0), 2.0 * 0.01 / 2.0, 1e-12);
  EXPECT_NEAR(found->covariance(2, 2), 2.0 * 0.01 / (2.0 * 25.0), 1e-12);
}

TEST(PointPairs, WhatCannotTellAPoseIsRefused) {
  EXPECT_FALSE(relative_pose_of({}, 0.1).has_value());
  EXPECT_FALSE(relative_pose_of(points_at({}, {{1.0, 0.0}}), 0.1).has_value());
  EXPECT_FALSE(relative_pose_of(points_at({}, {{0.0, 0.0}, {0.9, 0.0}}), 0.1).has_value()) << "base line";
  EXPECT_FALSE(relative_pose_of(points_at({}, {{0.0, 0.0}, {std::nan(""), 0.0}}), 0.1).has_value());
  EXPECT_FALSE(relative_pose_of(points_at({}, {{0.0, 0.0}, {2.0, 0.0}}), 0.0).has_value());
}

FinalResult solve(SimulatedRun& run, const OptimizerOptions& options) {
  Optimizer optimizer(options, run, run.tools());
  for (const auto& submap : run.submaps()) EXPECT_TRUE(optimizer.add_submap(submap));
  auto result = optimizer.finish();
  EXPECT_TRUE(result);
  return *result;
}

ManualTie true_tie(const SimulatedRun& run, std::uint32_t a, std::uint32_t b) {
  const Pose2 a_from_b = between(run.truth_of_submap(a), run.truth_of_submap(b));
  return {a, b, 0.02, points_at(a_from_b, {{0.0, 0.0}, {5.0, 1.0}, {2.0, -4.0}})};
}

const TieStress* find_tie(const FinalResult& result, std::uint32_t a, std::uint32_t b) {
  for (const TieStress& tie : result.ties) {
    if (tie.a == a && tie.b == b) return &tie;
  }
  return nullptr;
}

TEST(ManualTies, CloseARingWhoseLoopsAreWithheld) {
  SimulatedRun run(ring_path(160.0, 1.5), {});
  OptimizerOptions options;
  options.loops = false;
  const double open_m = rmse_m(run, solve(run, options).keyframes);
  const auto last = static_cast<std::uint32_t>(run.submaps().size() - 1);
  options.edits.ties = {true_tie(run, 0, 16), true_tie(run, 4, last - 3)};
  const FinalResult tied = solve(run, options);
  EXPECT_GT(open_m, 0.2);
  EXPECT_LT(rmse_m(run, tied.keyframes), 0.6 * open_m);
  const TieStress* const tie = find_tie(tied, 0, 16);
  ASSERT_NE(tie, nullptr);
  EXPECT_TRUE(tie->manual);
  EXPECT_LT(tie->sigmas, 4.0);
}

TEST(ManualTies, ABarredPairIsNotFoundAgain) {
  SimulatedRun run(ring_path(160.0, 1.5), {});
  const FinalResult found = solve(run, {});
  OptimizerOptions options;
  for (const Loop& loop : found.loops) options.edits.barred.emplace_back(loop.match.a, loop.match.b);
  ASSERT_FALSE(options.edits.barred.empty());
  for (const Loop& loop : solve(run, options).loops) {
    for (const auto& [a, b] : options.edits.barred) EXPECT_FALSE(loop.match.a == a && loop.match.b == b);
  }
}

TEST(ManualTies, OneThatContradictsTheRestIsShownStrainedAndStays) {
  SimulatedRun run(ring_path(160.0, 1.5), {});
  OptimizerOptions options;
  options.suspects = true;
  ManualTie wrong = true_tie(run, 0, 16);
  for (TiePoint& point : wrong.points) point.in_a += Eigen::Vector2d(3.0, 0.0);
  options.edits.ties = {wrong};
  const FinalResult result = solve(run, options);
  const TieStress* const tie = find_tie(result, 0, 16);
  ASSERT_NE(tie, nullptr);
  EXPECT_GT(tie->sigmas, 4.0);
  ASSERT_FALSE(result.suspects.empty());
  EXPECT_EQ(result.suspects.front().kind, SuspectPair::Kind::kStrained);
}

TEST(ManualTies, SuspectsAreSortedByEffectAndVanishWithTheLoops) {
  SimulatedRun run(ring_path(160.0, 1.5), {});
  OptimizerOptions options;
  options.suspects = true;
  options.loops = false;
  const FinalResult open = solve(run, options);
  ASSERT_FALSE(open.suspects.empty());
  for (std::size_t k = 1; k < open.suspects.size(); ++k) {
    EXPECT_GE(open.suspects[k - 1].effect_m, open.suspects[k].effect_m);
  }
  options.loops = true;
  EXPECT_LT(solve(run, options).suspects.size(), open.suspects.size() / 2);
}

}  // namespace
}  // namespace submapd
