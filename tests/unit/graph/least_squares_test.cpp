#include "slam/graph/internal/least_squares.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "slam/base/random.hpp"

namespace submapd::graph {
namespace {

constexpr double kScale = 1.5;
constexpr std::uint32_t kPoses = 25;

// A walk, and points each seen twice from different poses along it; one in ten is seen a metre off from one of them.
LeastSquaresGraph random_graph(std::uint64_t seed) {
  CounterRandom random(seed, 1, 0);
  LeastSquaresGraph graph;
  std::vector<Pose2> truth{{1.0, -2.0, 0.4}};
  for (std::uint32_t k = 1; k < kPoses; ++k) {
    const Pose2 step{random.uniform(0.2, 1.5), random.uniform(-0.3, 0.3), random.uniform(-0.6, 0.6)};
    truth.push_back(compose(truth.back(), step));
    Eigen::Matrix3d white = Eigen::Vector3d(40.0, 50.0, 90.0).asDiagonal();
    white(2, 0) = random.uniform(-10.0, 10.0);
    const Pose2 measured{step.x + random.uniform(-0.02, 0.02), step.y, step.yaw + random.uniform(-0.01, 0.01)};
    graph.pose_rows.push_back({k - 1, k, measured, white});
  }
  for (std::uint32_t k = 0; k < 60; ++k) {
    const auto first = static_cast<std::uint32_t>(random.uniform(0.0, kPoses - 1.01));
    const auto apart = static_cast<std::uint32_t>(random.uniform(1.0, kPoses - 1.01));
    const Eigen::Vector2d place =
        transform(truth[first], Eigen::Vector2d(random.uniform(-6.0, 6.0), random.uniform(-6.0, 6.0)));
    Eigen::Matrix2d white;
    white << random.uniform(5.0, 60.0), 0.0, random.uniform(-20.0, 20.0), random.uniform(5.0, 60.0);
    for (const std::uint32_t from : {first, (first + apart) % kPoses}) {
      // Alike in the map, as two looks at one wall are.
      const Eigen::Matrix2d turned = white * rotation(truth[from].yaw);
      Eigen::Vector2d z = transform(inverse(truth[from]), place);
      z += Eigen::Vector2d(random.uniform(-0.03, 0.03), random.uniform(-0.03, 0.03));
      if (k % 10 == 9 && from == first) z.x() += 1.0;
      graph.point_rows.push_back({from, k, z, turned});
    }
    graph.points.push_back(place + Eigen::Vector2d(random.uniform(-0.05, 0.05), random.uniform(-0.05, 0.05)));
  }
  for (std::size_t k = 0; k < truth.size(); ++k) {
    const double off = k == 0 ? 0.0 : 0.03;
    graph.poses.push_back({truth[k].x + random.uniform(-off, off), truth[k].y + random.uniform(-off, off),
                           truth[k].yaw + random.uniform(-off, off)});
  }
  return graph;
}

// A third row that weighs nothing keeps a point a variable: the same problem, with nothing eliminated.
LeastSquaresGraph with_points_kept(LeastSquaresGraph graph) {
  for (std::uint32_t k = 0; k < graph.points.size(); ++k) {
    graph.point_rows.push_back({0, k, Eigen::Vector2d::Zero(), 1e-9 * Eigen::Matrix2d::Identity()});
  }
  return graph;
}

TEST(LeastSquares, EliminatingPointsSeenTwiceFindsTheSameMinimum) {
  double worst_m = 0.0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    LeastSquaresGraph eliminated = random_graph(seed);
    LeastSquaresGraph kept = with_points_kept(eliminated);
    ASSERT_TRUE(solve(eliminated, {200, kScale}));
    ASSERT_TRUE(solve(kept, {200, kScale}));
    for (std::size_t k = 0; k < eliminated.poses.size(); ++k) {
      worst_m = std::max(worst_m, (eliminated.poses[k].translation() - kept.poses[k].translation()).norm());
    }
    // The points that come out are worth as much as those that were solved for.
    EXPECT_LT(cost(eliminated, kScale), 1.02 * cost(kept, kScale)) << "seed " << seed;
  }
  std::printf("farthest from the minimum over points, too: %.3f mm\n", 1e3 * worst_m);
  EXPECT_LT(worst_m, 3e-3);
}

TEST(LeastSquares, APointSeenTwiceFromOnePoseOrByNoneIsNoFailure) {
  LeastSquaresGraph graph;
  graph.poses = {{1.0, 2.0, 0.5}, {2.0, 2.0, 0.5}};
  graph.pose_rows.push_back({0, 1, {1.0, 0.0, 0.0}, 10.0 * Eigen::Matrix3d::Identity()});
  graph.points = {{0.0, 0.0}, {7.0, 7.0}};
  graph.point_rows.push_back({1, 0, {1.0, 1.0}, Eigen::Matrix2d::Identity()});
  graph.point_rows.push_back({1, 0, {1.2, 1.0}, Eigen::Matrix2d::Identity()});
  ASSERT_TRUE(solve(graph, {20, kScale}));
  EXPECT_LT((transform(inverse(graph.poses[1]), graph.points[0]) - Eigen::Vector2d(1.1, 1.0)).norm(), 1e-3);
  EXPECT_EQ(graph.points[1], Eigen::Vector2d(7.0, 7.0));
}

TEST(LeastSquares, CancelledItKeepsItsValues) {
  LeastSquaresGraph graph = random_graph(3);
  const LeastSquaresGraph before = graph;
  const std::atomic<bool> cancelled = true;
  const auto summary = solve(graph, {20, kScale, &cancelled});
  ASSERT_FALSE(summary);
  EXPECT_EQ(summary.error().code(), StatusCode::kUnavailable);
  EXPECT_EQ(graph.points, before.points);
}

}  // namespace
}  // namespace submapd::graph
