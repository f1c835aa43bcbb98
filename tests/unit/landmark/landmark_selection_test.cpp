// Virtual landmarks of matched sub-maps: spread, consistency with the truth, honest covariances, fresh key-frames.
#include "slam/landmark/landmark_selection.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "slam/landmark/landmark_observations.hpp"
#include "slam/loop/submap_matcher.hpp"
#include "tests/unit/loop/synthetic_submap.hpp"

namespace submapd::testing {
namespace {

struct Pair {
  Pair(const std::vector<Eigen::Vector2d>& way_b, const SyntheticSensor& sensor, const Twist2& twist = {}) {
    a = make_submap(office(), walk(office_tour(), 0.3, 0, twist), {sensor, 3, 1, 15.0});
    b = make_submap(office(), walk(way_b, 0.3, 1000, twist), {sensor, 9, 2, 15.0});
    truth = between(a.odom_from_submap, b.odom_from_submap);
    match = SubmapMatcher(SubmapMatcherOptions{}).refine(a, b, compose(truth, {0.05, -0.04, 0.005}));
  }
  FinishedSubmap a;
  FinishedSubmap b;
  Pose2 truth;
  SubmapMatch match;
};

const std::vector<Eigen::Vector2d> kBackwards{{15.5, 12.5}, {13.5, 10.5}, {13.5, 7.0}, {3.0, 7.2}, {3.5, 3.5}};

void expect_good_landmarks(const Pair& pair) {
  ASSERT_EQ(pair.match.verdict, MatchVerdict::kAccepted);
  const LandmarkOptions options;
  const auto landmarks = choose_landmarks(pair.a, pair.b, pair.match, options);
  ASSERT_GE(landmarks.size(), 6U);
  ASSERT_LE(landmarks.size(), 12U);
  double distance2_sum = 0.0;
  Eigen::Vector2d low = landmarks[0].in_a;
  Eigen::Vector2d high = low;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const VirtualLandmark& landmark = landmarks[i];
    low = low.cwiseMin(landmark.in_a);
    high = high.cwiseMax(landmark.in_a);
    EXPECT_EQ(landmark.a, 3U);
    EXPECT_EQ(landmark.b, 9U);
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_GE((landmarks[j].in_a - landmark.in_a).norm(), options.min_spacing_m);
    }
    // in_b, carried to a by the true pose, is where a has it, as far as the covariances claim.
    const Eigen::Matrix2d turn = rotation(pair.truth.yaw);
    const Eigen::Vector2d error = transform(pair.truth, landmark.in_b) - landmark.in_a;
    const Eigen::Matrix2d covariance = landmark.covariance_a + turn * landmark.covariance_b * turn.transpose();
    const double distance2 = error.dot(covariance.inverse() * error);
    EXPECT_LT(distance2, 9.0) << "landmark " << i;
    distance2_sum += distance2;

    const auto check_side = [&](const FinishedSubmap& submap, const std::vector<std::uint32_t>& seen_from,
                                const Eigen::Vector2d& in_submap, const Eigen::Matrix2d& claimed) {
      EXPECT_FALSE(seen_from.empty());
      for (const std::uint32_t index : seen_from) {
        const Keyframe& keyframe = submap.keyframes.at(index);
        const LandmarkObservation seen = observation_of(in_submap, claimed, keyframe.pose);
        EXPECT_LT((transform(keyframe.pose, seen.z) - in_submap).norm(), 1e-9);
        EXPECT_LE(seen.z.norm(), options.max_range_m + 0.5);
        EXPECT_TRUE(sees(keyframe, in_submap, options.max_range_m));
        const Eigen::Matrix2d R = rotation(keyframe.pose.yaw);
        EXPECT_TRUE((R * seen.covariance * R.transpose()).isApprox(claimed, 1e-6));
      }
    };
    check_side(pair.a, landmark.seen_from_a, landmark.in_a, landmark.covariance_a);
    check_side(pair.b, landmark.seen_from_b, landmark.in_b, landmark.covariance_b);
  }
  EXPECT_GT((high - low).minCoeff(), 5.0) << "landmarks must be spread";
  // Two figures a landmark; the inflation makes noise alone look small, but an error of centimetres must show.
  EXPECT_LT(distance2_sum / (2.0 * static_cast<double>(landmarks.size())), 1.5);
}

TEST(ChooseLandmarks, AgreeWithTheTruthForDenseScans) {
  expect_good_landmarks(Pair(kBackwards, SyntheticSensor::dense()));
}

TEST(ChooseLandmarks, AgreeWithTheTruthForSparseScans) {
  expect_good_landmarks(Pair(kBackwards, SyntheticSensor::sparse()));
}

TEST(ChooseLandmarks, AgreeWithTheTruthWhileMovingFast) {
  expect_good_landmarks(Pair(kBackwards, SyntheticSensor::dense(), {2.5, 0.0, 1.5}));
}

TEST(ChooseLandmarks, HoldBothDirectionsAndTheTurnTogether) {
  const Pair pair(kBackwards, SyntheticSensor::dense());
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const VirtualLandmark& landmark : choose_landmarks(pair.a, pair.b, pair.match, LandmarkOptions{})) {
    Eigen::Matrix<double, 2, 3> J;
    J << 1.0, 0.0, -landmark.in_a.y(), 0.0, 1.0, landmark.in_a.x();
    information += J.transpose() * landmark.covariance_a.inverse() * J;
  }
  const Eigen::Matrix3d covariance = information.inverse();
  EXPECT_LT(std::sqrt(covariance(2, 2)), 0.0035);  // 0.2 deg
}

TEST(ChooseLandmarks, ShowARealMisalignment) {
  // The match is told 5 cm wrong; b's own map must show it.
  const Pair pair(kBackwards, SyntheticSensor::dense());
  SubmapMatch shifted = pair.match;
  shifted.a_from_b.x += 0.05;
  const auto landmarks = choose_landmarks(pair.a, pair.b, shifted, LandmarkOptions{});
  ASSERT_GE(landmarks.size(), 4U);
  double across = 0.0;  // how far b's own map disagrees with the match, along what the landmark can see
  for (const VirtualLandmark& landmark : landmarks) {
    across = std::max(across, std::abs((transform(shifted.a_from_b, landmark.in_b) - landmark.in_a).x()));
  }
  EXPECT_GT(across, 0.04);
}

TEST(ChooseLandmarks, PreferKeyframesThatTheOtherDoesNotShare) {
  // Adjacent sub-maps: b begins halfway along a.
  const std::vector<TruePose> path = walk(office_tour(), 0.3, 0);
  const auto split = static_cast<std::ptrdiff_t>(path.size() / 2);
  const FinishedSubmap a =
      make_submap(office(), {path.begin(), path.begin() + 3 * split / 2}, {SyntheticSensor::dense(), 0, 1, 15.0});
  const FinishedSubmap b =
      make_submap(office(), {path.begin() + split, path.end()}, {SyntheticSensor::dense(), 1, 1, 15.0});
  const SubmapMatch match =
      SubmapMatcher(SubmapMatcherOptions{}).refine(a, b, between(a.odom_from_submap, b.odom_from_submap));
  ASSERT_EQ(match.verdict, MatchVerdict::kAccepted);
  const auto landmarks = choose_landmarks(a, b, match, LandmarkOptions{});
  ASSERT_GE(landmarks.size(), 4U);
  int shared = 0;
  int unshared = 0;
  for (const VirtualLandmark& landmark : landmarks) {
    for (const std::uint32_t keyframe : landmark.seen_from_a) {
      ++(has_scan(b, a.keyframes[keyframe].scan_index) ? shared : unshared);
    }
    for (const std::uint32_t keyframe : landmark.seen_from_b) {
      ++(has_scan(a, b.keyframes[keyframe].scan_index) ? shared : unshared);
    }
  }
  EXPECT_GT(unshared, 4 * shared);
}

TEST(ChooseLandmarks, TwoCallsGiveTheSameBits) {
  const Pair pair(kBackwards, SyntheticSensor::sparse());
  const auto first = choose_landmarks(pair.a, pair.b, pair.match, LandmarkOptions{});
  const auto second = choose_landmarks(pair.a, pair.b, pair.match, LandmarkOptions{});
  ASSERT_EQ(first.size(), second.size());
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].in_b, second[i].in_b);
    EXPECT_EQ(first[i].covariance_b, second[i].covariance_b);
  }
}

TEST(ChooseLandmarks, FindNothingWhereNothingIsCommon) {
  const Pair pair(kBackwards, SyntheticSensor::sparse());
  SubmapMatch far = pair.match;
  far.a_from_b.x += 200.0;
  EXPECT_TRUE(choose_landmarks(pair.a, pair.b, far, LandmarkOptions{}).empty());
}

TEST(Sees, UnwarpsTheSweepAndAsksForABeamThatEndsThere) {
  World world;
  world.wall(5.0, -3.0, 5.0, 3.0);
  const Twist2 fast{3.0, 0.0, 2.0};
  const FinishedSubmap submap = make_submap(world, {{0, {0.0, 0.0, 0.0}, fast}}, {});
  const Keyframe& keyframe = submap.keyframes[0];
  EXPECT_TRUE(sees(keyframe, {5.0, 0.0}, 12.0));
  EXPECT_TRUE(sees(keyframe, {5.0, 2.5}, 12.0));
  EXPECT_FALSE(sees(keyframe, {5.0, 3.4}, 12.0));  // past the wall's end
  EXPECT_FALSE(sees(keyframe, {6.0, 0.0}, 12.0));  // behind it
  EXPECT_FALSE(sees(keyframe, {5.0, 0.0}, 4.0));   // too far
  EXPECT_FALSE(sees(keyframe, {-5.0, 0.0}, 12.0));
}

}  // namespace
}  // namespace submapd::testing
