#include "slam/graph/internal/live_graph.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "slam/graph/internal/loop_policy.hpp"

namespace submapd::graph {
namespace {

const Eigen::Matrix3d kEdge = pose_covariance(0.02, 0.3 * kDegree);

// A chain of n sub-maps, 10 m apart, turning so that it bites its tail after 36.
GraphModel chain(std::uint32_t n) {
  GraphModel model;
  for (std::uint32_t k = 0; k < n; ++k) {
    ChainLink link;
    link.linked = k > 0;
    link.edge = {{10.0, 0.0, 10.0 * kDegree}, kEdge};
    model.links.push_back(link);
    model.poses.push_back(k == 0 ? Pose2{} : compose(model.poses.back(), link.edge.mean));
    model.submaps.emplace_back();
  }
  return model;
}

// A loop that wants b at `a_from_b`, tied by four landmarks.
LoopRecord loop_at(std::uint32_t a, std::uint32_t b, const Pose2& a_from_b, const Eigen::Vector3d& window) {
  LoopRecord record;
  record.loop.match.a = a;
  record.loop.match.b = b;
  record.loop.match.a_from_b = a_from_b;
  record.loop.match.covariance = pose_covariance(0.02, 0.1 * kDegree);
  record.loop.match.score = 0.9;
  record.window = window;
  for (const Eigen::Vector2d& in_b :
       {Eigen::Vector2d(4, 4), Eigen::Vector2d(-4, 4), Eigen::Vector2d(4, -4), Eigen::Vector2d(-4, -4)}) {
    VirtualLandmark landmark;
    landmark.a = a;
    landmark.b = b;
    landmark.in_b = in_b;
    landmark.in_a = transform(a_from_b, in_b);
    landmark.covariance_a = landmark.covariance_b = 1e-4 * Eigen::Matrix2d::Identity();
    record.landmarks.push_back(landmark);
  }
  return record;
}

Pose2 moved(const Pose2& pose, double x, double y, double yaw) {
  return {pose.x + x, pose.y + y, pose.yaw + yaw};
}

double largest_move(const std::vector<Pose2>& before, const std::vector<Pose2>& after) {
  double largest = 0.0;
  for (std::size_t k = 0; k < before.size(); ++k) {
    largest = std::max(largest, (before[k].translation() - after[k].translation()).norm());
  }
  return largest;
}

TEST(LiveGraph, PendingLoopsHaveNoRowAndNeverBend) {
  GraphModel model = chain(37);
  const std::vector<Pose2> before = model.poses;
  model.loops.push_back(loop_at(0, 36, {3.0, 2.0, 0.4}, {5, 5, 0.5}));
  ASSERT_TRUE(solve_live(model, {}));
  EXPECT_LT(largest_move(before, model.poses), 1e-9);
  EXPECT_TRUE(build_live_graph(model).point_rows.empty());
  model.loops[0].loop.state = LoopState::kConfirmed;
  EXPECT_EQ(build_live_graph(model).point_rows.size(), 8U);
}

TEST(LiveGraph, ALoopMayBeOneEdge) {
  GraphModel model = chain(37);
  model.parts.landmark_rows = false;
  const Pose2 wanted = moved(between(model.poses[0], model.poses[36]), 0.3, -0.2, 0.02);
  model.loops.push_back(loop_at(0, 36, wanted, {3, 3, 0.3}));
  EXPECT_EQ(build_live_graph(model).pose_rows.size(), 36U);
  model.loops[0].loop.state = LoopState::kConfirmed;
  const LeastSquaresGraph graph = build_live_graph(model);
  EXPECT_TRUE(graph.point_rows.empty());
  ASSERT_EQ(graph.pose_rows.size(), 37U);
  EXPECT_EQ(graph.pose_rows.back().measurement, wanted);
  const Eigen::Matrix3d information = graph.pose_rows.back().whitening.transpose() * graph.pose_rows.back().whitening;
  EXPECT_TRUE((information * model.measured(model.loops[0]).covariance).isIdentity(1e-9));
  ASSERT_TRUE(solve_live(model, {0}));
  EXPECT_LT(between(wanted, between(model.poses[0], model.poses[36])).translation().norm(), 0.05);
}

TEST(LiveGraph, ALoopOfManyMetresIsReachedAndKeepsItsWeight) {
  GraphModel model = chain(37);
  const Pose2 wanted = moved(between(model.poses[0], model.poses[36]), 2.0, -1.5, 0.06);
  model.loops.push_back(loop_at(0, 36, wanted, {15, 15, 1}));
  model.loops[0].loop.state = LoopState::kConfirmed;
  const auto summary = solve_live(model, {0});
  ASSERT_TRUE(summary);
  const Pose2 off = between(wanted, between(model.poses[0], model.poses[36]));
  EXPECT_LT(off.translation().norm(), 0.1);
  EXPECT_GT(loop_weight(model, model.loops[0]), 0.25);
  EXPECT_EQ(model.poses[0], Pose2{});  // the gauge
}

TEST(LiveGraph, SpreadingMeetsTheLoopAndMovesTheRestRigidly) {
  GraphModel model = chain(40);
  const Pose2 wanted = moved(between(model.poses[2], model.poses[30]), 2.0, 1.0, 0.3);
  const auto poses = spread_closure(model, loop_at(2, 30, wanted, {5, 5, 1}));
  const Pose2 met = between(wanted, between(poses[2], poses[30]));
  EXPECT_LT(met.translation().norm() + std::abs(met.yaw), 1e-9);
  for (std::size_t k = 31; k < poses.size(); ++k) {
    const Pose2 rest = between(between(model.poses[30], model.poses[k]), between(poses[30], poses[k]));
    EXPECT_LT(rest.translation().norm() + std::abs(rest.yaw), 1e-9);
  }
  EXPECT_EQ(poses[2], model.poses[2]);
}

TEST(LiveGraph, NeighboursWithLandmarksCountHalfTwice) {
  GraphModel model = chain(2);
  const LeastSquaresGraph alone = build_live_graph(model);
  model.links[1].landmarks = loop_at(0, 1, model.links[1].edge.mean, {1, 1, 0.1}).landmarks;
  const LeastSquaresGraph both = build_live_graph(model);
  ASSERT_EQ(both.pose_rows.size(), 1U);
  const Eigen::Matrix3d ratio = both.pose_rows[0].whitening * alone.pose_rows[0].whitening.inverse() * std::sqrt(2.0);
  EXPECT_LT((ratio - Eigen::Matrix3d::Identity()).norm(), 1e-9);
}

TEST(LoopPolicy, OneLoopWaitsForASecondThatAgrees) {
  GraphModel model = chain(37);
  const Pose2 drift{0.8, -0.5, 0.05};
  const auto true_loop = [&](std::uint32_t a, std::uint32_t b) {
    return loop_at(a, b, between(model.poses[a], compose(drift, model.poses[b])), {3, 3, 0.3});
  };
  model.loops.push_back(true_loop(0, 35));
  EXPECT_TRUE(confirm_loops(model, false).empty());
  model.loops.push_back(true_loop(1, 36));
  EXPECT_EQ(confirm_loops(model, false), (std::vector<std::size_t>{0, 1}));
}

TEST(LoopPolicy, WithoutPairwiseConsistencyOneLoopIsEnoughUnlessTheGraphContradictsIt) {
  GraphModel model = chain(37);
  const auto off_by = [&](double x) {
    return loop_at(0, 35, moved(between(model.poses[0], model.poses[35]), x, 0.0, 0.0), {3, 3, 0.3});
  };
  model.loops = {off_by(0.8), off_by(12.0)};
  EXPECT_TRUE(confirm_loops(model, false).empty());
  model.parts.pairwise_consistency = false;
  EXPECT_EQ(confirm_loops(model, false), (std::vector<std::size_t>{0}));
}

TEST(LoopPolicy, TwoThatDisagreeWait) {
  GraphModel model = chain(37);
  const auto at = [&](std::uint32_t a, std::uint32_t b, double x) {
    return loop_at(a, b, moved(between(model.poses[a], model.poses[b]), x, 0.0, 0.0), {3, 3, 0.3});
  };
  model.loops = {at(0, 35, 1.0), at(1, 36, -1.0)};
  EXPECT_TRUE(confirm_loops(model, false).empty());
}

TEST(LoopPolicy, TwoEqualCliquesThatContradictEachOtherWait) {
  GraphModel model = chain(39);
  const auto at = [&](std::uint32_t a, std::uint32_t b, const Pose2& drift) {
    return loop_at(a, b, between(model.poses[a], compose(drift, model.poses[b])), {3, 3, 0.3});
  };
  const Pose2 one{1.0, 0.0, 0.0};
  const Pose2 other{-1.0, 0.5, 0.0};
  model.loops = {at(0, 35, one), at(1, 36, one), at(0, 37, other), at(1, 38, other)};
  EXPECT_TRUE(confirm_loops(model, false).empty());
  model.loops.push_back(at(2, 37, one));
  EXPECT_EQ(confirm_loops(model, false), (std::vector<std::size_t>{0, 1, 4}));
}

TEST(LoopPolicy, ALoneLoopIsAcceptedOnlyAtTheEndAndOnlyWhereThePredictionIsTight) {
  GraphModel model = chain(12);
  const Pose2 near_by = moved(between(model.poses[0], model.poses[4]), 0.03, -0.02, 0.002);
  model.loops.push_back(loop_at(0, 4, near_by, {1.0, 1.0, 5.0 * kDegree}));
  EXPECT_TRUE(confirm_loops(model, false).empty());
  model.loops.push_back(loop_at(0, 11, between(model.poses[0], model.poses[11]), {1.0, 1.0, 5.0 * kDegree}));
  GraphModel weak = model;
  weak.loops[0].loop.match.score = 0.6;
  EXPECT_TRUE(confirm_loops(weak, true).empty());
  for (ChainLink& link : model.links) link.edge.covariance = pose_covariance(0.005, 0.05 * kDegree);
  GraphModel contradicted = model;
  for (LoopRecord& record : contradicted.loops) record.loop.match.contradiction = 0.05;
  EXPECT_TRUE(confirm_loops(contradicted, true).empty());
  contradicted.parts.contradiction_test = false;
  EXPECT_FALSE(confirm_loops(contradicted, true).empty());
  GraphModel loose = model;
  for (ChainLink& link : loose.links) link.edge.covariance = pose_covariance(0.2, 3.0 * kDegree);
  EXPECT_EQ(confirm_loops(model, true).empty(), false);
  EXPECT_TRUE(confirm_loops(loose, true).empty());
}

TEST(LoopPolicy, AConfirmedLoopTheGraphCannotMeetGoesBackToPending) {
  GraphModel model = chain(37);
  const auto add = [&](std::uint32_t a, std::uint32_t b, double x) {
    model.loops.push_back(loop_at(a, b, moved(between(model.poses[a], model.poses[b]), x, 0.0, 0.0), {3, 3, 0.3}));
    model.loops.back().loop.state = LoopState::kConfirmed;
  };
  for (std::uint32_t k = 0; k < 5; ++k) add(k, 32 + k, 0.0);
  add(2, 33, 2.0);
  ASSERT_TRUE(solve_live(model, {}));
  EXPECT_EQ(demote_loops(model), 1);
  EXPECT_EQ(model.loops.back().loop.state, LoopState::kPending);
  EXPECT_TRUE(confirm_loops(model, false).empty());
  ASSERT_TRUE(solve_live(model, {}));
  EXPECT_LT(largest_move(chain(37).poses, model.poses), 1e-6);
  EXPECT_EQ(reject_contradicted(model), 1);
  EXPECT_TRUE(model.loops.back().landmarks.empty());
}

TEST(LiveGraph, ASolveThatIsCancelledLeavesThePosesAsTheyWere) {
  GraphModel model = chain(30);
  model.loops.push_back(loop_at(0, 29, {3.0, 1.0, 0.2}, {1.0, 1.0, 0.1}));
  model.loops.back().loop.state = LoopState::kConfirmed;
  const std::vector<Pose2> before = model.poses;
  std::atomic<bool> cancelled{true};
  const auto refused = solve_live(model, {}, &cancelled);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code(), StatusCode::kUnavailable);
  for (std::size_t k = 0; k < before.size(); ++k) EXPECT_EQ(model.poses[k].x, before[k].x);
  cancelled = false;
  ASSERT_TRUE(solve_live(model, {}, &cancelled));
  EXPECT_NE(model.poses.back().x, before.back().x);
}

}  // namespace
}  // namespace submapd::graph
