// The pinned words are from a separate implementation of SplitMix64's finaliser in Python; replays depend on them.
#include "slam/base/random.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <vector>

namespace submapd {
namespace {

TEST(CounterRandomTest, KnownValues) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();
  const std::map<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t>, std::array<std::uint64_t, 3>> known{
      {{0, 0, 0}, {0xa4c62257a6388d35, 0xedda73d782b6447f, 0x7f10efdc3c807e4a}},
      {{1, 2, 3}, {0xd154dcd0ec56bdad, 0x0ba41575bbd022da, 0xef5cfa775ba6e4fc}},
      {{kMost, kMost, kMost}, {0x1a89b94e9304d2f4, 0xca008bb1d6904748, 0x3e0edf4ab0cf3c5d}}};
  for (const auto& [key, words] : known) {
    CounterRandom random(std::get<0>(key), std::get<1>(key), std::get<2>(key));
    for (const std::uint64_t word : words) EXPECT_EQ(random.next_u64(), word);
  }
}

TEST(CounterRandomTest, TheOrderOfAskingDoesNotMatter) {
  constexpr std::uint64_t kStreams = 8;
  std::vector<std::vector<double>> one_by_one(kStreams);
  for (std::uint64_t b = 0; b < kStreams; ++b) {
    CounterRandom random(5, 17, b);
    for (int i = 0; i < 10; ++i) one_by_one[b].push_back(random.gaussian());
  }
  std::vector<CounterRandom> interleaved;
  for (std::uint64_t b = 0; b < kStreams; ++b) interleaved.emplace_back(5, 17, b);
  for (std::size_t i = 0; i < 10; ++i) {
    for (std::size_t b = kStreams; b-- > 0;) EXPECT_EQ(interleaved[b].gaussian(), one_by_one[b][i]);
  }
}

TEST(CounterRandomTest, NeighbouringKeysGiveDifferentStreams) {
  std::set<std::uint64_t> first_words;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    for (std::uint64_t a = 0; a < 20; ++a) {
      for (std::uint64_t b = 0; b < 20; ++b) first_words.insert(CounterRandom(seed, a, b).next_u64());
    }
  }
  EXPECT_EQ(first_words.size(), 8000U);
}

TEST(CounterRandomTest, NeighbouringStreamsAreUncorrelated) {
  constexpr int kDraws = 100'000;
  double sum = 0.0;
  for (std::uint64_t i = 0; i < kDraws; ++i) {
    sum += CounterRandom(1, i, 0).gaussian() * CounterRandom(1, i, 1).gaussian();
  }
  EXPECT_NEAR(sum / kDraws, 0.0, 4.0 / std::sqrt(kDraws));
}

TEST(CounterRandomTest, UniformFillsItsRangeEvenly) {
  constexpr int kDraws = 100'000;
  CounterRandom random(3, 1, 4);
  std::array<int, 10> bins{};
  for (int i = 0; i < kDraws; ++i) {
    const double value = random.uniform();
    ASSERT_GE(value, 0.0);
    ASSERT_LT(value, 1.0);
    ++bins[static_cast<std::size_t>(value * 10.0)];
  }
  for (const int count : bins) EXPECT_NEAR(count, kDraws / 10, 4.0 * std::sqrt(kDraws * 0.09));
  for (int i = 0; i < 1000; ++i) {
    const double value = random.uniform(-3.0, -1.0);
    ASSERT_GE(value, -3.0);
    ASSERT_LT(value, -1.0);
  }
}

TEST(CounterRandomTest, GaussianHasItsMoments) {
  constexpr int kDraws = 200'000;
  CounterRandom random(2, 7, 1);
  double m1 = 0.0;
  double m2 = 0.0;
  double m3 = 0.0;
  double m4 = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    const double g = random.gaussian();
    ASSERT_TRUE(std::isfinite(g));
    m1 += g / kDraws;
    m2 += g * g / kDraws;
    m3 += g * g * g / kDraws;
    m4 += g * g * g * g / kDraws;
  }
  // Four standard errors: the variances of g, g^2, g^3 and g^4 are 1, 2, 15 and 96.
  const double error = 4.0 / std::sqrt(kDraws);
  EXPECT_NEAR(m1, 0.0, error);
  EXPECT_NEAR(m2, 1.0, error * std::sqrt(2.0));
  EXPECT_NEAR(m3, 0.0, error * std::sqrt(15.0));
  EXPECT_NEAR(m4, 3.0, error * std::sqrt(96.0));
}

}  // namespace
}  // namespace submapd
