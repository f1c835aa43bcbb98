#include "slam/graph/internal/graph_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "slam/base/random.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"

namespace submapd::graph {
namespace {

const Eigen::Matrix3d kStep = pose_covariance(0.001, 0.02 * kDegree);

// Key-frames first..last of a cart going along a gentle curve, posed relative to the first of them.
FinishedSubmap piece(std::uint64_t first, std::uint64_t last, const Eigen::Matrix3d& step = kStep) {
  const auto track = [](std::uint64_t k) {
    const double s = 0.2 * static_cast<double>(k);
    return Pose2{s, 0.01 * s * s, 0.02 * s};
  };
  FinishedSubmap submap;
  submap.odom_from_submap = track(first);
  for (std::uint64_t k = first; k <= last; ++k) {
    Keyframe keyframe;
    keyframe.scan_index = k;
    keyframe.pose = between(track(first), track(k));
    keyframe.step_covariance = step;
    submap.keyframes.push_back(keyframe);
  }
  return submap;
}

SubmapRecord record(const FinishedSubmap& submap) {
  return make_record(submap, {});
}

TEST(UncertainPose, CompositionAndInverseMatchSampling) {
  const UncertainPose a{{3.0, -1.0, 0.7}, pose_covariance(0.02, 0.01)};
  const UncertainPose b{{5.0, 2.0, -2.9}, pose_covariance(0.03, 0.02)};
  const auto sample = [](const UncertainPose& p, CounterRandom& random) {
    const Eigen::Vector3d sigma = p.covariance.diagonal().cwiseSqrt();
    return Pose2{p.mean.x + sigma.x() * random.gaussian(), p.mean.y + sigma.y() * random.gaussian(),
                 p.mean.yaw + sigma.z() * random.gaussian()};
  };
  CounterRandom random(3, 0, 0);
  constexpr int kSamples = 40'000;
  Eigen::Matrix3d of_product = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d of_inverse = Eigen::Matrix3d::Zero();
  const UncertainPose product = compose(a, b);
  const UncertainPose back = inverse(a);
  for (int k = 0; k < kSamples; ++k) {
    const Pose2 a_k = sample(a, random);
    const Pose2 p = compose(a_k, sample(b, random));
    const Pose2 q = inverse(a_k);
    const Eigen::Vector3d d(p.x - product.mean.x, p.y - product.mean.y, p.yaw - product.mean.yaw);
    const Eigen::Vector3d e(q.x - back.mean.x, q.y - back.mean.y, q.yaw - back.mean.yaw);
    of_product += d * d.transpose() / kSamples;
    of_inverse += e * e.transpose() / kSamples;
  }
  EXPECT_LT((of_product - product.covariance).norm(), 0.03 * product.covariance.norm());
  EXPECT_LT((of_inverse - back.covariance).norm(), 0.03 * back.covariance.norm());
}

TEST(ChainLink, KnowsTheRelativePoseOfSubmapsThatShareATrack) {
  const FinishedSubmap a = piece(0, 80);
  const FinishedSubmap b = piece(40, 120);
  const ChainLink link = make_link(record(a), record(b), true);
  ASSERT_TRUE(link.linked);
  const Pose2 expected = between(a.odom_from_submap, b.odom_from_submap);
  EXPECT_NEAR(link.edge.mean.x, expected.x, 1e-12);
  EXPECT_NEAR(link.edge.mean.y, expected.y, 1e-12);
  EXPECT_NEAR(link.edge.mean.yaw, expected.yaw, 1e-12);
}

TEST(ChainLink, WithoutSpreadItsCovarianceIsThatOfTheStepsAndTheFloor) {
  const ChainLink link = make_link(record(piece(0, 80)), record(piece(40, 120)), true);
  const double floor_rad = 0.2 * kDegree;
  EXPECT_NEAR(link.edge.covariance(2, 2), 40.0 * kStep(2, 2) + floor_rad * floor_rad, 1e-9);
  EXPECT_GT(link.edge.covariance(0, 0), 40.0 * kStep(0, 0));
  EXPECT_GT(link.edge.covariance(1, 1), link.edge.covariance(0, 0));  // heading errors add across the way
  const ChainLink at_once = make_link(record(piece(0, 80)), record(piece(0, 120)), true);
  EXPECT_NEAR(at_once.edge.covariance(0, 0), 0.01 * 0.01, 1e-12);
}

TEST(ChainLink, SpreadOfTheSharedKeyframesWidensIt) {
  const FinishedSubmap a = piece(0, 80);
  FinishedSubmap b = piece(40, 120);
  const Eigen::Matrix3d tight = make_link(record(a), record(b), true).edge.covariance;
  CounterRandom random(5, 0, 0);
  for (Keyframe& keyframe : b.keyframes) keyframe.pose.y += 0.1 * random.gaussian();
  const Eigen::Matrix3d wide = make_link(record(a), record(b), true).edge.covariance;
  // 41 shared ones, each 0.1 m off: 4 * 0.1^2 / 41.
  EXPECT_NEAR(wide(1, 1) - tight(1, 1), 4.0 * 0.01 / 41.0, 0.0005);
}

TEST(ChainLink, DegenerateSpanKeepsItsLargeCovarianceAlongItsAxis) {
  const FinishedSubmap b = piece(40, 120);
  FinishedSubmap a = piece(0, 80);
  for (std::size_t k = 10; k < 20; ++k) {
    a.keyframes[k].degenerate = true;
    a.keyframes[k].step_covariance(0, 0) = 0.04;  // 20 cm a step along the way
  }
  const Eigen::Matrix3d covariance = make_link(record(a), record(b), true).edge.covariance;
  EXPECT_GT(covariance(0, 0), 0.38);
  EXPECT_LT(covariance(1, 1), 0.05);
  // After b's origin it is no business of the link.
  FinishedSubmap later = piece(0, 80);
  later.keyframes[60].step_covariance(0, 0) = 4.0;
  EXPECT_LT(make_link(record(later), record(b), true).edge.covariance(0, 0), 0.01);
}

TEST(ChainLink, HeadingMeanDoesNotBreakAtPi) {
  FinishedSubmap a = piece(0, 20);
  FinishedSubmap b = piece(10, 30);
  const double jump = 2.0 * std::numbers::pi;
  for (std::size_t k = 0; k < a.keyframes.size(); ++k) a.keyframes[k].pose.yaw += std::numbers::pi - 0.04;
  for (std::size_t k = 0; k < b.keyframes.size(); k += 2) b.keyframes[k].pose.yaw += jump;
  const ChainLink link = make_link(record(a), record(b), true);
  EXPECT_LT(link.edge.covariance(2, 2), 1e-4);
}

TEST(ChainLink, BreakIsSoftAndPlacedByOdometry) {
  const FinishedSubmap a = piece(0, 40);
  const FinishedSubmap b = piece(60, 100);
  for (const ChainLink& link :
       {make_link(record(a), record(b), true), make_link(record(a), record(piece(30, 70)), false)}) {
    EXPECT_FALSE(link.linked);
    EXPECT_DOUBLE_EQ(link.edge.covariance(0, 0), 100.0);
    EXPECT_DOUBLE_EQ(link.edge.covariance(2, 2), 1.0);
  }
  const Pose2 expected = between(a.odom_from_submap, b.odom_from_submap);
  EXPECT_NEAR(make_link(record(a), record(b), true).edge.mean.x, expected.x, 1e-12);
}

TEST(RelativeUncertainty, GrowsAlongTheChainAndShrinksAcrossALoop) {
  GraphModel model;
  for (std::uint32_t k = 0; k < 20; ++k) {
    model.submaps.push_back(record(piece(40 * k, 40 * k + 80)));
    model.links.push_back(k == 0 ? ChainLink{} : make_link(model.submaps[k - 1], model.submaps[k], true));
    model.poses.push_back(k == 0 ? Pose2{} : compose(model.poses.back(), model.links[k].edge.mean));
  }
  RelativeUncertainty chain(model);
  double last = 0.0;
  for (std::uint32_t k = 1; k < 20; ++k) {
    const RelativePose& relative = chain.between_submaps(0, k);
    EXPECT_FALSE(relative.through_loop);
    EXPECT_GT(relative.pose.covariance(2, 2), last);
    last = relative.pose.covariance(2, 2);
  }
  LoopRecord loop;
  loop.loop.match.a = 0;
  loop.loop.match.b = 18;
  loop.loop.match.a_from_b = between(model.poses[0], model.poses[18]);
  loop.loop.match.covariance = pose_covariance(0.02, 0.1 * kDegree);
  model.loops.push_back(loop);
  RelativeUncertainty pending(model);
  EXPECT_DOUBLE_EQ(pending.between_submaps(0, 19).pose.covariance(2, 2), last);
  model.loops[0].loop.state = LoopState::kConfirmed;
  RelativeUncertainty closed(model);
  EXPECT_TRUE(closed.between_submaps(0, 19).through_loop);
  EXPECT_LT(closed.between_submaps(0, 19).pose.covariance(2, 2), last / 2.0);
  // Seen from the other end it is as uncertain in heading.
  EXPECT_NEAR(closed.between_submaps(19, 0).pose.covariance(2, 2), closed.between_submaps(0, 19).pose.covariance(2, 2),
              1e-12);
}

}  // namespace
}  // namespace submapd::graph
