// Weights of any magnitude, and both ways of drawing from them.
#include "slam/filter/resampling.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace submapd {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double sum_of(const std::vector<double>& weights) {
  return std::accumulate(weights.begin(), weights.end(), 0.0);
}

std::vector<double> normalised(const std::vector<double>& log_weights, double* n_eff = nullptr) {
  std::vector<double> weights(log_weights.size());
  const double effective = normalise_weights(log_weights, weights);
  if (n_eff != nullptr) *n_eff = effective;
  return weights;
}

std::vector<int> counts_of(const std::vector<int>& ancestors, std::size_t n) {
  std::vector<int> counts(n);
  for (const int a : ancestors) ++counts.at(static_cast<std::size_t>(a));
  return counts;
}

// Weights of 1 .. 40 particles; one in five is zero, but not all.
std::vector<double> any_weights() {
  const auto n = static_cast<std::size_t>(*rc::gen::inRange(1, 40));
  std::vector<double> weights(n);
  for (double& w : weights) w = *rc::gen::inRange(0, 5) == 0 ? 0.0 : *rc::gen::inRange(1, 1000);
  if (sum_of(weights) <= 0.0) weights[0] = 1.0;
  const double sum = sum_of(weights);
  for (double& w : weights) w /= sum;
  return weights;
}

TEST(NormaliseWeightsTest, KnownEffectiveNumbers) {
  double n_eff = 0.0;
  normalised({0.0, 0.0, 0.0, 0.0}, &n_eff);
  EXPECT_DOUBLE_EQ(n_eff, 4.0);
  const std::vector<double> weights = normalised({std::log(1.0), std::log(3.0)}, &n_eff);
  EXPECT_NEAR(weights[0], 0.25, 1e-15);
  EXPECT_NEAR(weights[1], 0.75, 1e-15);
  EXPECT_NEAR(n_eff, 1.6, 1e-12);  // 1 / (1/16 + 9/16)
  normalised({5.0, -kInfinity, -kInfinity}, &n_eff);
  EXPECT_DOUBLE_EQ(n_eff, 1.0);
}

TEST(NormaliseWeightsTest, MagnitudeDoesNotMatter) {
  for (const double shift : {-1e300, -1e6, -800.0, 800.0, 1e6, 1e300}) {
    double n_eff = 0.0;
    const std::vector<double> weights = normalised({shift, shift}, &n_eff);
    EXPECT_EQ(weights, (std::vector<double>{0.5, 0.5})) << shift;
    EXPECT_DOUBLE_EQ(n_eff, 2.0) << shift;
  }
  const std::vector<double> weights = normalised({-1e4, -1e4 + std::log(4.0), -2e4});
  EXPECT_NEAR(weights[0], 0.2, 1e-9);
  EXPECT_NEAR(weights[1], 0.8, 1e-9);
  EXPECT_EQ(weights[2], 0.0);
}

TEST(NormaliseWeightsTest, WhatIsNoNumberWeighsNothing) {
  EXPECT_EQ(normalised({kNan, -3.0, -kInfinity, kInfinity}), (std::vector<double>{0.0, 1.0, 0.0, 0.0}));
}

TEST(NormaliseWeightsTest, WithoutAnyEvidenceAllWeighTheSame) {
  for (const double nothing : {-kInfinity, kNan}) {
    double n_eff = 0.0;
    EXPECT_EQ(normalised({nothing, nothing, nothing, nothing}, &n_eff), std::vector<double>(4, 0.25));
    EXPECT_DOUBLE_EQ(n_eff, 4.0);
  }
}

RC_GTEST_PROP(NormaliseWeightsTest, WeightsSumToOneAndNEffIsBetweenOneAndN, ()) {
  const auto logs = *rc::gen::nonEmpty<std::vector<double>>();
  double n_eff = 0.0;
  const std::vector<double> weights = normalised(logs, &n_eff);
  RC_ASSERT(std::abs(sum_of(weights) - 1.0) < 1e-9);
  for (const double w : weights) RC_ASSERT(w >= 0.0 && w <= 1.0);
  RC_ASSERT(n_eff >= 1.0 - 1e-9 && n_eff <= static_cast<double>(logs.size()) + 1e-9);
}

RC_GTEST_PROP(ResampleSystematicTest, EveryCountIsFloorOrCeilingOfItsShare, ()) {
  const std::vector<double> weights = any_weights();
  const auto n = static_cast<double>(weights.size());
  CounterRandom random(*rc::gen::arbitrary<std::uint64_t>(), 1, 2);
  std::vector<int> ancestors(weights.size());
  resample_systematic(weights, random, ancestors);
  RC_ASSERT(std::is_sorted(ancestors.begin(), ancestors.end()));
  const std::vector<int> counts = counts_of(ancestors, weights.size());
  for (std::size_t i = 0; i < weights.size(); ++i) {
    // Rounding aside: a share of exactly 2 may come out as 2.0000000001.
    RC_ASSERT(counts[i] >= static_cast<int>(std::floor(n * weights[i] - 1e-9)));
    RC_ASSERT(counts[i] <= static_cast<int>(std::ceil(n * weights[i] + 1e-9)));
    if (weights[i] <= 0.0) {
      RC_ASSERT(counts[i] == 0);
    }
  }
}

// Mean count of each particle over many draws against n w, by the binomial's standard error (systematic has less).
void expect_fair(void (*resample)(std::span<const double>, CounterRandom&, std::span<int>)) {
  const std::vector<double> weights = {0.05, 0.0, 0.5, 0.15, 0.3};
  constexpr std::size_t kDraws = 20'000;
  std::vector<double> mean(weights.size());
  std::vector<int> ancestors(weights.size());
  for (std::uint64_t k = 0; k < kDraws; ++k) {
    CounterRandom random(7, k, 0);
    resample(weights, random, ancestors);
    const std::vector<int> counts = counts_of(ancestors, weights.size());
    for (std::size_t i = 0; i < weights.size(); ++i) mean[i] += counts[i] / static_cast<double>(kDraws);
  }
  for (std::size_t i = 0; i < weights.size(); ++i) {
    // One turn of the wheel is not independent of the next: all five may fall together, which multiplies sigma by
    // sqrt 5.
    const double sigma = 5.0 * std::sqrt(weights[i] * (1.0 - weights[i]) / kDraws);
    EXPECT_NEAR(mean[i], 5.0 * weights[i], 4.0 * sigma) << "particle " << i;
  }
}

TEST(ResampleSystematicTest, ExpectationIsTheWeight) {
  expect_fair(resample_systematic);
}
TEST(ResampleWheelTest, ExpectationIsTheWeight) {
  expect_fair(resample_wheel);
}

RC_GTEST_PROP(ResampleWheelTest, DrawsOnlyWhatHasWeight, ()) {
  const std::vector<double> weights = any_weights();
  CounterRandom random(*rc::gen::arbitrary<std::uint64_t>(), 3, 4);
  std::vector<int> ancestors(weights.size(), -1);
  resample_wheel(weights, random, ancestors);
  for (const int a : ancestors) RC_ASSERT(weights.at(static_cast<std::size_t>(a)) > 0.0);
}

TEST(ResampleTest, OneParticleIsItsOwnAncestor) {
  std::vector<int> ancestor{9};
  CounterRandom random(1, 2, 3);
  resample_systematic(std::vector<double>{1.0}, random, ancestor);
  EXPECT_EQ(ancestor[0], 0);
  resample_wheel(std::vector<double>{1.0}, random, ancestor);
  EXPECT_EQ(ancestor[0], 0);
}

}  // namespace
}  // namespace submapd
