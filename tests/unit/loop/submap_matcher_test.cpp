// Matching of two sub-maps of known relative pose: recovery, refusal, ambiguity, determinism.
#include "slam/loop/submap_matcher.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <numbers>
#include <optional>

#include "slam/base/random.hpp"
#include "tests/unit/loop/synthetic_submap.hpp"

namespace submapd::testing {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

MatchPrior prior_at(const Pose2& pose, double sigma_m, double sigma_rad) {
  return {pose, Eigen::Vector3d(sigma_m, sigma_m, sigma_rad).cwiseAbs2().asDiagonal()};
}

Pose2 true_pose(const FinishedSubmap& a, const FinishedSubmap& b) {
  return between(a.odom_from_submap, b.odom_from_submap);
}

struct Error {
  double m;
  double rad;
};
Error error_of(const SubmapMatch& match, const Pose2& truth) {
  const Pose2 error = between(truth, match.a_from_b);
  return {error.translation().norm(), std::abs(error.yaw)};
}

// Two visits to the office: the second goes another way round, half a day and other noise later.
struct TwoVisits {
  explicit TwoVisits(const SyntheticSensor& sensor) {
    a = make_submap(office(), walk(office_tour(), 0.3, 0), {sensor, 0, 1, 15.0});
    b = make_submap(office(), walk({{15.5, 12.5}, {13.5, 10.5}, {13.5, 7.0}, {3.0, 7.2}, {3.5, 3.5}}, 0.3, 1000),
                    {sensor, 5, 2, 15.0});
  }
  FinishedSubmap a;
  FinishedSubmap b;
};

void expect_recovery(const SyntheticSensor& sensor, double limit_m, double limit_rad) {
  const TwoVisits visits(sensor);
  const Pose2 truth = true_pose(visits.a, visits.b);
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  for (std::uint64_t trial = 0; trial < 6; ++trial) {
    CounterRandom random(7, trial, 0);
    const Pose2 off{truth.x + random.uniform(-3.0, 3.0), truth.y + random.uniform(-3.0, 3.0),
                    truth.yaw + random.uniform(-20.0, 20.0) * kDegree};
    const SubmapMatch match = matcher.search(visits.a, visits.b, prior_at(off, 1.2, 8.0 * kDegree));
    ASSERT_EQ(match.verdict, MatchVerdict::kAccepted)
        << "trial " << trial << " score " << match.score << " overlap " << match.overlap_m2 << " share "
        << match.overlap_share << " contradiction " << match.contradiction << " second " << match.second_peak;
    EXPECT_LT(error_of(match, truth).m, limit_m) << "trial " << trial;
    EXPECT_LT(error_of(match, truth).rad, limit_rad) << "trial " << trial;
    EXPECT_FALSE(match.weak);
    EXPECT_EQ(match.a, 0U);
    EXPECT_EQ(match.b, 5U);
  }
}

TEST(SubmapMatcher, FindsDenseSubMapsFromAPoorPrior) {
  expect_recovery(SyntheticSensor::dense(), 0.01, 0.1 * kDegree);
}

TEST(SubmapMatcher, FindsSparseSubMapsFromAPoorPrior) {
  expect_recovery(SyntheticSensor::sparse(), 0.03, 0.4 * kDegree);
}

TEST(SubmapMatcher, FindsAnyHeadingWhenNothingIsKnownOfIt) {
  const TwoVisits visits(SyntheticSensor::dense());
  const Pose2 truth = true_pose(visits.a, visits.b);
  const Pose2 off{truth.x + 5.0, truth.y - 4.0, truth.yaw + 2.5};
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).search(visits.a, visits.b, prior_at(off, 3.3, 1.1));
  ASSERT_EQ(match.verdict, MatchVerdict::kAccepted) << match.second_peak;
  EXPECT_LT(error_of(match, truth).m, 0.01);
  EXPECT_LT(error_of(match, truth).rad, 0.1 * kDegree);
}

TEST(SubmapMatcher, TwoCallsGiveTheSameBits) {
  const TwoVisits visits(SyntheticSensor::sparse());
  const MatchPrior prior = prior_at(true_pose(visits.a, visits.b), 0.5, 0.05);
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  const SubmapMatch first = matcher.search(visits.a, visits.b, prior);
  const SubmapMatch second = matcher.search(visits.a, visits.b, prior);
  EXPECT_EQ(first.a_from_b, second.a_from_b);
  EXPECT_EQ(first.covariance, second.covariance);
  EXPECT_EQ(first.score, second.score);
  EXPECT_EQ(first.verdict, second.verdict);
}

// Rooms alike but for a cabinet.
FinishedSubmap twin_room(bool cabinet, std::uint32_t index) {
  World world;
  world.box(0.0, 0.0, 7.0, 5.5).box(5.5, 4.3, 6.9, 5.4).wall(0.0, 3.0, 0.8, 3.0);
  if (cabinet) {
    world.box(3.2, 2.4, 4.4, 3.0);
  }
  return make_submap(world, walk({{1.0, 1.0}, {6.0, 1.0}, {6.0, 3.8}, {1.5, 3.8}, {1.5, 1.5}}, 0.25, 100 * index),
                     {SyntheticSensor::dense(), index, index + 1, 15.0});
}

TEST(SubmapMatcher, ACabinetTellsTwinRoomsApart) {
  const FinishedSubmap with = twin_room(true, 0);
  const FinishedSubmap without = twin_room(false, 1);
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  const SubmapMatch twins = matcher.search(with, without, prior_at({0.2, 0.1, 0.02}, 0.5, 0.05));
  EXPECT_EQ(twins.verdict, MatchVerdict::kContradiction) << twins.contradiction;
  SubmapMatcherOptions credulous;
  credulous.contradiction_test = false;
  EXPECT_EQ(SubmapMatcher(credulous).search(with, without, prior_at({0.2, 0.1, 0.02}, 0.5, 0.05)).verdict,
            MatchVerdict::kAccepted);
  const SubmapMatch same = matcher.search(with, twin_room(true, 2), prior_at({0.2, 0.1, 0.02}, 0.5, 0.05));
  EXPECT_EQ(same.verdict, MatchVerdict::kAccepted) << same.contradiction;
  EXPECT_LT(same.contradiction, 0.5 * twins.contradiction);
}

// Somebody who walked where the cabinet stands was hit by a key-frame or two.
TEST(SubmapMatcher, PassersByContradictNothing) {
  FinishedSubmap person = twin_room(true, 0);
  for (SurfacePoint& p : person.surface) {
    const bool of_cabinet = p.x > 2.1F && p.x < 3.5F && p.y > 1.3F && p.y < 2.1F;
    if (of_cabinet) p.keyframes = 2;
  }
  const SubmapMatch match =
      SubmapMatcher(SubmapMatcherOptions{}).search(person, twin_room(false, 1), prior_at({0.2, 0.1, 0.02}, 0.5, 0.05));
  EXPECT_EQ(match.verdict, MatchVerdict::kAccepted) << match.contradiction;
}

SurfacePoint point_at(float x, float y, std::uint16_t keyframes, float sigma_m) {
  SurfacePoint point;
  point.x = x;
  point.y = y;
  point.sigma_m = sigma_m;
  point.hits = 50;
  point.keyframes = keyframes;
  return point;
}

// Somebody stood where the cells are free again, in more key-frames than a passer-by.
TEST(SubmapMatcher, WhoeverHasGoneStandsForNothing) {
  FinishedSubmap left = twin_room(false, 0);
  const FinishedSubmap again = twin_room(false, 1);
  const MatchPrior prior = prior_at({0.2, 0.1, 0.02}, 0.5, 0.05);
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  const SubmapMatch before = matcher.search(left, again, prior);
  for (int k = 0; k < 400; ++k) {
    left.surface.push_back(
        point_at(2.1F + 0.07F * static_cast<float>(k % 20), 1.2F + 0.07F * static_cast<float>(k / 20), 10, 0.02F));
  }
  const SubmapMatch after = matcher.search(left, again, prior);
  EXPECT_EQ(after.verdict, MatchVerdict::kAccepted);
  EXPECT_NEAR(after.score, before.score, 0.02);
}

TEST(SurfaceIndex, LastingIsWhatIsThinAndOfThreeKeyframes) {
  FinishedSubmap submap;
  submap.surface = {point_at(0.0F, 0.0F, 3, 0.02F), point_at(0.0F, 1.0F, 5, 0.02F), point_at(0.0F, 2.0F, 2, 0.02F),
                    point_at(0.0F, 3.0F, 5, 0.08F)};
  const SurfaceIndex index(submap, std::nullopt);
  ASSERT_EQ(index.elements().size(), 4U);
  for (const SurfaceElement& element : index.elements()) EXPECT_EQ(element.lasting, element.source < 2);
}

// Pillars every 3 m along a hall, and one cupboard: a bay farther all but the cupboard fits.
TEST(SubmapMatcher, ARivalThatIsContradictedIsNone) {
  World hall;
  hall.wall(-30.0, 0.0, 50.0, 0.0).wall(-30.0, 6.0, 50.0, 6.0).box(7.4, 2.4, 9.2, 3.6);
  for (int k = -10; k < 17; ++k) {
    hall.box(3.0 * k - 0.2, 0.0, 3.0 * k + 0.2, 0.6).box(3.0 * k - 0.2, 5.4, 3.0 * k + 0.2, 6.0);
  }
  const auto visit = [&hall](double from_m, std::uint32_t index) {
    return make_submap(
        hall, walk({{from_m, 1.6}, {from_m + 5.0, 1.6}, {from_m + 5.0, 4.4}, {from_m, 4.4}}, 0.25, 100 * index),
        {SyntheticSensor::dense(), index, index + 1, 5.0});
  };
  const FinishedSubmap a = visit(4.5, 0);
  const FinishedSubmap b = visit(5.5, 1);
  const Pose2 truth = true_pose(a, b);
  SubmapMatcherOptions credulous;
  credulous.contradiction_test = false;
  const MatchPrior prior = prior_at(truth, 1.2, 0.05);
  EXPECT_EQ(SubmapMatcher(credulous).search(a, b, prior).verdict, MatchVerdict::kAmbiguous);
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).search(a, b, prior);
  EXPECT_EQ(match.verdict, MatchVerdict::kAccepted) << match.second_peak << ' ' << match.contradiction;
  EXPECT_LT(error_of(match, truth).m, 0.05);
}

TEST(SubmapMatcher, ABareCorridorIsWeakOrAmbiguous) {
  World world;
  world.box(0.0, 0.0, 100.0, 2.5);
  const FinishedSubmap a =
      make_submap(world, walk({{40.0, 1.2}, {50.0, 1.2}}, 0.3, 0), {SyntheticSensor::dense(), 0, 1, 15.0});
  const FinishedSubmap b =
      make_submap(world, walk({{43.0, 1.3}, {53.0, 1.3}}, 0.3, 500), {SyntheticSensor::dense(), 1, 2, 15.0});
  const Pose2 truth = true_pose(a, b);
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  const SubmapMatch match = matcher.search(a, b, prior_at(truth, 0.3, 0.02));
  EXPECT_TRUE(match.weak || match.verdict == MatchVerdict::kAmbiguous) << match.second_peak;

  const SubmapMatch refined = matcher.refine(a, b, compose(truth, {0.0, 0.04, 0.005}));
  EXPECT_TRUE(refined.weak);
  SubmapMatcherOptions demanding;
  demanding.min_overlap_share = 1.1;
  EXPECT_EQ(SubmapMatcher(demanding).refine(a, b, truth).verdict, MatchVerdict::kSmallOverlap);
  EXPECT_GT(refined.covariance(0, 0), 0.1 * 0.1);    // along
  EXPECT_LT(refined.covariance(1, 1), 0.02 * 0.02);  // across
  EXPECT_NEAR(refined.a_from_b.y, truth.y, 0.01);
  EXPECT_NEAR(refined.a_from_b.yaw, truth.yaw, 0.2 * kDegree);
}

TEST(SubmapMatcher, ASmallShareWillDoWhereWallsFixThePlace) {
  SubmapMatcherOptions demanding;
  demanding.min_overlap_share = 1.1;
  const TwoVisits visits(SyntheticSensor::dense());
  EXPECT_EQ(SubmapMatcher(demanding).refine(visits.a, visits.b, true_pose(visits.a, visits.b)).verdict,
            MatchVerdict::kAccepted);
}

TEST(SubmapMatcher, RefusesSubMapsThatDoNotOverlap) {
  const FinishedSubmap a =
      make_submap(office(), walk({{3.5, 3.5}, {1.0, 3.0}}, 0.3, 0), {SyntheticSensor::dense(), 0, 1, 15.0});
  const FinishedSubmap b =
      make_submap(office(), walk({{15.5, 12.5}, {12.0, 10.5}}, 0.3, 100), {SyntheticSensor::dense(), 1, 2, 15.0});
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).search(a, b, prior_at(true_pose(a, b), 1.0, 0.1));
  EXPECT_NE(match.verdict, MatchVerdict::kAccepted);
}

TEST(SubmapMatcher, RefusesEmptyAndHugeSubMaps) {
  FinishedSubmap empty;
  FinishedSubmap huge;
  huge.blocks.resize(2);
  huge.blocks[1].bx = 1000;
  const SubmapMatcher matcher(SubmapMatcherOptions{});
  EXPECT_EQ(matcher.search(empty, huge, MatchPrior{}).verdict, MatchVerdict::kNoPeak);
  EXPECT_EQ(matcher.search(huge, huge, MatchPrior{}).verdict, MatchVerdict::kNoPeak);
  EXPECT_EQ(matcher.refine(huge, empty, Pose2{}).verdict, MatchVerdict::kLowScore);
}

TEST(SubmapMatcher, RefinesFromAFewCentimetres) {
  const TwoVisits visits(SyntheticSensor::dense());
  const Pose2 truth = true_pose(visits.a, visits.b);
  const Pose2 start = compose(truth, {0.12, -0.08, 0.015});
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).refine(visits.a, visits.b, start);
  ASSERT_EQ(match.verdict, MatchVerdict::kAccepted);
  EXPECT_LT(error_of(match, truth).m, 0.01);
  EXPECT_LT(error_of(match, truth).rad, 0.1 * kDegree);
}

TEST(SubmapMatcher, RefinementThatRunsAwayFallsBackToItsStart) {
  const TwoVisits visits(SyntheticSensor::dense());
  const Pose2 start = compose(true_pose(visits.a, visits.b), {0.0, 0.0, 0.09});
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).refine(visits.a, visits.b, start);
  EXPECT_EQ(match.verdict, MatchVerdict::kLowScore);
  EXPECT_EQ(match.a_from_b, start);
}

TEST(SubmapMatcher, GateRefusesWhatThePriorExcludes) {
  const TwoVisits visits(SyntheticSensor::dense());
  const Pose2 truth = true_pose(visits.a, visits.b);
  const Pose2 off{truth.x + 0.6, truth.y, truth.yaw};
  const SubmapMatch match = SubmapMatcher(SubmapMatcherOptions{}).search(visits.a, visits.b, prior_at(off, 0.05, 0.01));
  EXPECT_EQ(match.verdict, MatchVerdict::kGate);
}

}  // namespace
}  // namespace submapd::testing
