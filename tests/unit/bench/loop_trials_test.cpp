// Loop trials on places that are known: what counts as false, as unambiguous, and what is drawn.
#include "tests/bench/loop_trials.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "slam/graph/internal/uncertain_pose.hpp"
#include "tests/unit/loop/synthetic_submap.hpp"

namespace submapd::bench {
namespace {

using graph::kDegree;
using testing::make_submap;
using testing::TruePose;

MatchPrior prior_at(const Pose2& pose, double sigma_m, double sigma_deg) {
  return {pose, graph::pose_covariance(sigma_m, sigma_deg * kDegree)};
}

TEST(LoopTrials, AMatchIsFalseBeyondEitherLimit) {
  const Pose2 truth{3.0, -2.0, 3.1};
  EXPECT_FALSE(is_false(truth, compose(truth, {0.29, 0.0, 1.9 * kDegree})));
  EXPECT_TRUE(is_false(truth, compose(truth, {0.0, 0.31, 0.0})));
  EXPECT_TRUE(is_false(truth, compose(truth, {0.0, 0.0, -2.1 * kDegree})));
  EXPECT_FALSE(is_false(truth, {truth.x, truth.y, truth.yaw - 2.0 * std::numbers::pi}));
}

TEST(LoopTrials, ParallelWallsFixOneDirectionOnly) {
  SubmapOutline known;
  for (std::int16_t y = -4; y < 4; ++y) {
    for (std::int16_t x = -40; x < 40; ++x) known.known.push_back({x, y});
  }
  FinishedSubmap corridor;
  for (int k = 0; k < 100; ++k) {
    const auto along = 0.1F * static_cast<float>(k);
    corridor.surface.push_back({along, 1.0F, 0.0F, -1.0F, 0.01F, 9, 3, 1});
    corridor.surface.push_back({along, -1.0F, 0.0F, 1.0F, 0.01F, 9, 3, 1});
  }
  const Pose2 turned{1.0, 0.0, 0.0};
  EXPECT_NEAR(structure_of(corridor, known, turned), 0.0, 1e-9);
  for (int k = 0; k < 20; ++k) {  // its end: 2 m of 22
    corridor.surface.push_back({10.0F, -1.0F + 0.1F * static_cast<float>(k), -1.0F, 0.0F, 0.01F, 9, 3, 1});
  }
  EXPECT_NEAR(structure_of(corridor, known, turned), 0.1, 1e-6);
  EXPECT_NEAR(structure_of(corridor, known, {15.0, 0.0, 0.0}), 0.0, 1e-9) << "the end lies where a knows nothing";
  EXPECT_EQ(structure_of(corridor, known, {100.0, 0.0, 0.0}), 0.0);
}

TEST(LoopTrials, ADoubleCountsWhereTheWindowHoldsIt) {
  const std::vector<Eigen::Vector2d> grid = {{7.5, 0.0}, {0.0, 16.0}};
  const Pose2 a{10.0, 20.0, 90.0 * kDegree};  // the world's x is a's -y
  const Pose2 b{12.0, 21.0, 0.0};
  const Pose2 truth = between(a, b);
  EXPECT_FALSE(alias_in_window(grid, a, b, prior_at(truth, 2.0, 2.0))) << "6 m, and the double is 7.5 m away";
  EXPECT_TRUE(alias_in_window(grid, a, b, prior_at(truth, 2.6, 2.0)));
  EXPECT_TRUE(alias_in_window(grid, a, b, prior_at({truth.x, truth.y + 2.0, truth.yaw}, 2.0, 2.0)));
  EXPECT_FALSE(alias_in_window(grid, a, b, prior_at({truth.x + 2.0, truth.y, truth.yaw}, 2.0, 2.0)));
  EXPECT_FALSE(alias_in_window(grid, a, b, prior_at({truth.x, truth.y, truth.yaw + 1.0}, 2.6, 2.0)));
  EXPECT_FALSE(alias_in_window({}, a, b, prior_at(truth, 3.0, 12.0)));
}

// The tour of the office, twice, as sub-maps of 40 key-frames that share half of them with the next.
TrialRun office_run() {
  std::vector<TruePose> way = testing::walk(testing::office_tour(), 0.3, 0);
  const std::vector<TruePose> again = testing::walk(testing::office_tour(), 0.3, way.size());
  way.insert(way.end(), again.begin(), again.end());
  TrialRun run;
  for (std::size_t first = 0; first + 40 <= way.size(); first += 20) {
    const std::vector<TruePose> part(way.begin() + static_cast<std::ptrdiff_t>(first),
                                     way.begin() + static_cast<std::ptrdiff_t>(first + 40));
    testing::SyntheticOptions options;
    options.index = static_cast<std::uint32_t>(run.submaps.size());
    run.submaps.push_back(std::make_shared<FinishedSubmap>(make_submap(testing::office(), part, options)));
    run.world_from_submap.push_back(part.front().world_from_base);
  }
  return run;
}

TEST(LoopTrials, WhatIsDrawnIsWithinItsCovarianceAndTheSameAgain) {
  const TrialRun run = office_run();
  const TrialGround ground(run, {1, {}});
  const TrialGround other(run, {2, {}});
  ASSERT_GT(ground.pairs(TrialKind::kOverlapping), 3U);
  EXPECT_EQ(ground.pairs(TrialKind::kDeceived), 0U);
  EXPECT_FALSE(ground.draw(TrialKind::kDeceived, 0));
  double least_m = 1.0;
  double most_m = 1.0;
  int differ = 0;
  for (std::uint64_t number = 0; number < 40; ++number) {
    const std::optional<Trial> trial = ground.draw(TrialKind::kOverlapping, number);
    ASSERT_TRUE(trial);
    EXPECT_GE(trial->overlap_m2, 25.0);
    EXPECT_EQ(trial->a_from_b, between(run.world_from_submap[trial->a], run.world_from_submap[trial->b]));
    const Pose2& prior = trial->prior.a_from_b;
    EXPECT_LE(std::abs(prior.x - trial->a_from_b.x), 3.0 * trial->sigma_m);
    EXPECT_LE(std::abs(prior.y - trial->a_from_b.y), 3.0 * trial->sigma_m);
    EXPECT_LE(std::abs(wrap_angle(prior.yaw - trial->a_from_b.yaw)), 3.0 * trial->sigma_rad);
    least_m = std::min(least_m, trial->sigma_m);
    most_m = std::max(most_m, trial->sigma_m);
    EXPECT_EQ(ground.draw(TrialKind::kOverlapping, number)->prior.a_from_b, prior);
    differ += other.draw(TrialKind::kOverlapping, number)->prior.a_from_b == prior ? 0 : 1;
  }
  EXPECT_EQ(differ, 40);
  EXPECT_LT(least_m, 0.4);
  EXPECT_GT(most_m, 1.5);
}

TEST(LoopTrials, TrueLoopsOfAnOfficeAreFoundAndALieIsSeenAsOne) {
  TrialRun run = office_run();
  const TrialGround ground(run, {1, {}});
  int found = 0;
  int confirmed = 0;
  for (std::uint64_t number = 0; number < 6; ++number) {
    const std::optional<Trial> trial = ground.draw(TrialKind::kOverlapping, number);
    const TrialResult result = ground.run(*trial);
    EXPECT_TRUE(result.wrong_confirmed.empty());
    found += result.accepted && !is_false(trial->a_from_b, result.match.a_from_b) ? 1 : 0;
    confirmed += result.confirmed ? 1 : 0;
  }
  EXPECT_GE(found, 4);
  EXPECT_GE(confirmed, 2);

  // The second round is said to have been a metre from where it was: what was found there is now false.
  const auto first_of_second = run.submaps.size() / 2;
  for (std::size_t k = first_of_second; k < run.submaps.size(); ++k) run.world_from_submap[k].x += 1.0;
  const TrialGround moved(run, {1, {}});
  std::size_t wrong = 0;
  for (std::uint64_t number = 0; number < 6; ++number) {
    wrong += moved.run(*moved.draw(TrialKind::kOverlapping, number)).wrong_confirmed.size();
  }
  EXPECT_GT(wrong, 0U);
}

}  // namespace
}  // namespace submapd::bench
