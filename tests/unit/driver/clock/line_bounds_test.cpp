// LineBounds against the bounds one by one: what it says is possible holds the truth, and nothing much more.
#include "driver/clock/line_bounds.hpp"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <vector>

#include "slam/base/random.hpp"

namespace submapd::driver::test {
namespace {

TEST(LineBounds, SaysNothingThatItWasNotTold) {
  LineBounds bounds({.slope_low = -2.0, .slope_high = 3.0});
  EXPECT_LT(bounds.at(0.0).low, -1e12);
  EXPECT_GT(bounds.at(0.0).high, 1e12);
  EXPECT_EQ(bounds.slope().low, -2.0);
  EXPECT_EQ(bounds.slope().high, 3.0);
}

TEST(LineBounds, TwoGatesGiveTheLinesThroughThem) {
  LineBounds bounds({.slope_low = -10.0, .slope_high = 10.0});
  bounds.below(0.0, 1.0);
  bounds.above(0.0, -1.0);
  bounds.below(10.0, 21.0);
  bounds.above(10.0, 19.0);
  EXPECT_NEAR(bounds.slope().low, 1.8, 1e-9);
  EXPECT_NEAR(bounds.slope().high, 2.2, 1e-9);
  EXPECT_NEAR(bounds.at(20.0).low, 37.0, 1e-9);
  EXPECT_NEAR(bounds.at(20.0).high, 43.0, 1e-9);
  EXPECT_NEAR(bounds.at(20.0, {2.0, 2.0}).width(), 2.0, 1e-9);
}

TEST(LineBounds, WhatBendsIsForgottenWithItsSquare) {
  LineBounds bounds({.slope_low = 0.0, .slope_high = 0.0, .bend = 0.02});
  bounds.below(0.0, 1.0);
  bounds.above(0.0, -1.0);
  EXPECT_NEAR(bounds.at(10.0).high, 1.0 + 0.01 * 100.0, 1e-9);
  EXPECT_NEAR(bounds.at(10.0).low, -2.0, 1e-9);
}

TEST(LineBounds, ContradictionIsNoticedAndResetHeals) {
  LineBounds bounds({});
  bounds.below(0.0, 0.0);
  bounds.above(1.0, 5.0);
  EXPECT_TRUE(bounds.contradictory());
  bounds.reset();
  EXPECT_FALSE(bounds.contradictory());
  bounds.below(0.0, 0.0);
  EXPECT_NEAR(bounds.at(1.0).high, 1.0, 1e-9);
}

// Random bends within the promise, random bounds on either side, far more than the hulls hold.
RC_GTEST_PROP(LineBounds, TheTruthIsNeverExcluded, ()) {
  const double bend = *rc::gen::element(0.0, 0.02, 1.0);
  const auto seed = *rc::gen::arbitrary<std::uint64_t>();
  CounterRandom random(seed, 0, 0);
  LineBounds bounds({.slope_low = -50.0, .slope_high = 50.0, .bend = bend, .horizon = 100.0});
  double value = 1e6;
  double slope = random.uniform(-20.0, 20.0);
  double x = 0.0;
  for (int i = 0; i < 400; ++i) {
    const double dx = random.uniform(0.0, 1.0);
    const double bent = random.uniform(-bend, bend);
    value += slope * dx + 0.5 * bent * dx * dx;
    slope = slope + bent * dx;
    x += dx;
    if (std::abs(slope) > 50.0) break;  // outside the promise
    if (random.uniform() < 0.5) bounds.below(x, value + random.uniform(0.0, 10.0));
    if (random.uniform() < 0.5) bounds.above(x, value - random.uniform(0.0, 10.0));
    RC_ASSERT(!bounds.contradictory());
    const Interval possible = bounds.at(x);
    RC_ASSERT(possible.low <= value + 1e-6);
    RC_ASSERT(possible.high >= value - 1e-6);
    if (bounds.newest_x() == x) {
      RC_ASSERT(bounds.slope().low <= slope + 1e-6);
      RC_ASSERT(bounds.slope().high >= slope - 1e-6);
    }
  }
}

// The hull keeps what matters: of straight lines, as tight as all bounds together, tried slope by slope.
RC_GTEST_PROP(LineBounds, TheHullIsAsTightAsAllBounds, ()) {
  const auto seed = *rc::gen::arbitrary<std::uint64_t>();
  CounterRandom random(seed, 1, 0);
  LineBounds bounds({.slope_low = 0.0, .slope_high = 6.0});
  struct Bound {
    double x;
    double low;
    double high;
  };
  std::vector<Bound> all;
  for (int i = 0; i < 40; ++i) {
    const double x = i + random.uniform();
    all.push_back({x, 3.0 * x - random.uniform(0.1, 5.0), 3.0 * x + random.uniform(0.1, 5.0)});
    bounds.below(x, all.back().high);
    bounds.above(x, all.back().low);
  }
  const double end = bounds.newest_x();
  double highest = -1e9;
  for (double slope = 0.0; slope <= 6.0; slope += 0.001) {
    double low = -1e9;
    double high = 1e9;
    for (const Bound& b : all) {
      const double dx = b.x - end;
      low = std::max(low, b.low - slope * dx);
      high = std::min(high, b.high - slope * dx);
    }
    if (low <= high) highest = std::max(highest, high);
  }
  RC_ASSERT(bounds.at(end).high >= highest - 1e-6);
  RC_ASSERT(bounds.at(end).high <= highest + 0.05);
}

}  // namespace
}  // namespace submapd::driver::test
