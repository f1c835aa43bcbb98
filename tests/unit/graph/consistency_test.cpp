#include "slam/graph/internal/consistency.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "slam/base/random.hpp"

namespace submapd::graph {
namespace {

std::vector<std::vector<bool>> table(std::size_t n, const std::vector<std::pair<std::size_t, std::size_t>>& edges) {
  std::vector<std::vector<bool>> agree(n, std::vector<bool>(n, false));
  for (const auto& [i, j] : edges) agree[i][j] = agree[j][i] = true;
  return agree;
}

// Largest clique by trying every subset.
std::size_t brute_force(const std::vector<std::vector<bool>>& agree) {
  const std::size_t n = agree.size();
  std::size_t best = 0;
  for (std::size_t set = 0; set < std::size_t{1} << n; ++set) {
    std::size_t size = 0;
    bool clique = true;
    for (std::size_t i = 0; i < n && clique; ++i) {
      if ((set >> i & 1U) == 0) continue;
      ++size;
      for (std::size_t j = 0; j < i; ++j) clique = clique && ((set >> j & 1U) == 0 || agree[i][j]);
    }
    if (clique) best = std::max(best, size);
  }
  return best;
}

TEST(LargestClique, KnownSets) {
  EXPECT_TRUE(largest_clique({}).empty());
  EXPECT_EQ(largest_clique(table(1, {})), (std::vector<std::size_t>{0}));
  EXPECT_EQ(largest_clique(table(4, {{1, 3}})), (std::vector<std::size_t>{1, 3}));
  // A triangle 2-3-5 and a long path.
  EXPECT_EQ(largest_clique(table(7, {{0, 1}, {1, 2}, {2, 3}, {3, 5}, {2, 5}, {5, 6}, {4, 6}})),
            (std::vector<std::size_t>{2, 3, 5}));
  // Of two equal ones the earlier.
  EXPECT_EQ(largest_clique(table(6, {{0, 4}, {1, 5}})), (std::vector<std::size_t>{0, 4}));
}

TEST(LargestClique, AsLargeAsBruteForceFinds) {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    CounterRandom random(11, seed, 0);
    const std::size_t n = 12;
    std::vector<std::pair<std::size_t, std::size_t>> edges;
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (random.uniform() < 0.55) edges.emplace_back(i, j);
      }
    }
    const auto agree = table(n, edges);
    const auto clique = largest_clique(agree);
    EXPECT_EQ(clique.size(), brute_force(agree)) << "seed " << seed;
    for (const std::size_t i : clique) {
      for (const std::size_t j : clique) EXPECT_TRUE(i == j || agree[i][j]);
    }
  }
}

TEST(LargestClique, GreedyBeyondSixtyStillFindsAPlantedOne) {
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  for (std::size_t i = 0; i < 100; i += 5) {
    for (std::size_t j = 0; j < i; j += 5) edges.emplace_back(i, j);
  }
  EXPECT_EQ(largest_clique(table(100, edges)).size(), 20U);
}

TEST(Consistency, TrueLoopsPassAtTheRateOfTheGate) {
  const UncertainPose x_ij{{10.0, 1.0, 0.3}, pose_covariance(0.05, 0.01)};
  const UncertainPose x_lk{{-9.0, 2.0, -0.2}, pose_covariance(0.05, 0.01)};
  const Eigen::Matrix3d match = pose_covariance(0.02, 0.004);
  const Pose2 z_ik{0.5, 0.3, 3.1};
  const Pose2 z_jl = compose(compose(inverse(x_ij.mean), z_ik), inverse(x_lk.mean));
  const auto noisy = [](const UncertainPose& p, CounterRandom& random) {
    const Eigen::Vector3d sigma = p.covariance.diagonal().cwiseSqrt();
    return UncertainPose{{p.mean.x + sigma.x() * random.gaussian(), p.mean.y + sigma.y() * random.gaussian(),
                          p.mean.yaw + sigma.z() * random.gaussian()},
                         p.covariance};
  };
  CounterRandom random(13, 0, 0);
  constexpr int kTrials = 4000;
  int passed = 0;
  double sum = 0.0;
  for (int k = 0; k < kTrials; ++k) {
    const Consistency verdict = judge_cycle(noisy({z_ik, match}, random), noisy(x_ij, random),
                                            noisy({z_jl, match}, random), noisy(x_lk, random), {5.0, 5.0, 0.5});
    passed += verdict.agrees(1.0) ? 1 : 0;
    sum += verdict.mahalanobis2;
  }
  EXPECT_NEAR(sum / kTrials, 3.0, 0.15);  // NEES of three degrees of freedom
  EXPECT_NEAR(static_cast<double>(passed) / kTrials, 0.99, 0.006);
}

TEST(Consistency, FalseLoopsPassAtTheChanceItStates) {
  const UncertainPose none{{}, pose_covariance(0.0, 0.0)};
  const UncertainPose z{{}, pose_covariance(0.1, 0.02)};
  const Eigen::Vector3d window(2.0, 2.0, 0.5);
  CounterRandom random(17, 0, 0);
  constexpr int kTrials = 40'000;
  int passed = 0;
  double chance = 0.0;
  for (int k = 0; k < kTrials; ++k) {
    const UncertainPose lie{{random.uniform(-2.0, 2.0), random.uniform(-2.0, 2.0), random.uniform(-0.5, 0.5)},
                            z.covariance};
    const Consistency verdict = judge_cycle(z, none, lie, none, window);
    chance += verdict.chance / kTrials;
    passed += verdict.agrees(1.0) ? 1 : 0;
  }
  EXPECT_NEAR(static_cast<double>(passed) / kTrials, chance, 0.1 * chance);
}

TEST(Consistency, AGateAsWideAsTheWindowProvesNothing) {
  const Consistency verdict = judge({}, pose_covariance(2.0, 0.3), {1.0, 1.0, 0.1});
  EXPECT_LT(verdict.mahalanobis2, 1e-9);
  EXPECT_FALSE(verdict.agrees(0.5));
  EXPECT_FALSE(judge({0.1, 0.0, 0.0}, Eigen::Matrix3d::Zero(), {1.0, 1.0, 0.1}).agrees(1.0));
}

}  // namespace
}  // namespace submapd::graph
