#include "slam/graph/internal/final_graph.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "tests/unit/graph/simulated_run.hpp"

namespace submapd::graph {
namespace {

using submapd::testing::ring_path;
using submapd::testing::SimulatedRun;
using submapd::testing::SimulatedRunOptions;

// The model as the live part would have it, poses taken from `poses_of`; every pair of neighbours tied by landmarks.
GraphModel model_of(const SimulatedRun& run) {
  GraphModel model;
  const PairTools tools = run.tools();
  for (const auto& submap : run.submaps()) {
    model.submaps.push_back(make_record(*submap, tools.make_outline(*submap)));
    const std::size_t k = model.submaps.size() - 1;
    ChainLink link;
    if (k > 0) {
      link = make_link(model.submaps[k - 1], model.submaps[k], submap->linked_to_previous);
      const auto& before = *run.submaps()[k - 1];
      if (link.linked) link.landmarks = tools.choose_landmarks(before, *submap, tools.refine(before, *submap, {}));
    }
    model.poses.push_back(k == 0 ? submap->odom_from_submap : compose(model.poses.back(), link.edge.mean));
    model.links.push_back(std::move(link));
  }
  return model;
}

double largest_move(const std::vector<OptimizedKeyframe>& before, const std::vector<OptimizedKeyframe>& after) {
  double largest = 0.0;
  for (std::size_t k = 0; k < before.size(); ++k) {
    const Pose2 move = between(before[k].map_from_base, after[k].map_from_base);
    largest = std::max({largest, move.translation().norm(), std::abs(move.yaw)});
  }
  return largest;
}

TEST(FinalGraph, AKeyframeInTwoSubmapsIsOneVariable) {
  const SimulatedRun run(ring_path(160.0, 0.5), {});
  const TrackGraph graph = build_track_graph(model_of(run));
  ASSERT_EQ(graph.track.size(), run.truth().size());
  EXPECT_EQ(graph.chain.size(), graph.track.size() - 1);
  for (std::size_t k = 0; k < graph.track.size(); ++k) EXPECT_EQ(graph.track[k].scan_index, k);
}

TEST(FinalGraph, AnExactGraphStaysWhereItIs) {
  SimulatedRunOptions exact;
  exact.step_sigma_m = exact.step_sigma_rad = 0.0;
  exact.match_noise = 0.0;
  const SimulatedRun run(ring_path(160.0, 1.0), exact);
  TrackGraph graph = build_track_graph(model_of(run));
  const auto before = graph.track;
  const auto summary = solve_track_graph(graph);
  ASSERT_TRUE(summary) << summary.error().message();
  EXPECT_LT(largest_move(before, graph.track), 1e-6);
  EXPECT_LT(summary->final_cost, 1e-9);
}

// Key-frames that see no landmark are not solved for; they come out where the whole problem has them.
TEST(FinalGraph, KeyframesThatOnlyPassTheChainOnComeOutAsIfSolvedFor) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SimulatedRunOptions options;
    options.seed = seed;
    const SimulatedRun run(ring_path(160.0, 0.7), options);
    TrackGraph graph = build_track_graph(model_of(run));
    LeastSquaresGraph whole;
    for (const OptimizedKeyframe& keyframe : graph.track) whole.poses.push_back(keyframe.map_from_base);
    whole.points = graph.landmarks;
    for (const ChainRow& row : graph.chain) {
      whole.pose_rows.push_back({row.from, row.to, row.measurement, whitening_or_soft(row.covariance)});
    }
    std::vector<bool> needed(graph.track.size(), false);
    for (const auto& row : graph.sights) {
      whole.point_rows.push_back({row.track_point, row.landmark, row.z, *whitening(row.covariance)});
      needed[row.track_point] = true;
    }
    const std::size_t rows = TrackChains(graph.chain, needed).rows().size();
    EXPECT_LT(3 * rows, 2 * graph.chain.size());
    std::vector<OptimizedKeyframe> expected = graph.track;
    ASSERT_TRUE(solve(whole, {50, 2.385}));
    for (std::size_t k = 0; k < expected.size(); ++k) expected[k].map_from_base = whole.poses[k];
    EXPECT_GT(largest_move(graph.track, expected), 1e-3);
    ASSERT_TRUE(solve_track_graph(graph));
    EXPECT_LT(largest_move(graph.track, expected), 2e-4);
  }
}

TEST(FinalGraph, AChainIsNotCompoundedAcrossABreak) {
  const Eigen::Matrix3d sure = Eigen::Vector3d(1e-4, 1e-4, 1e-6).asDiagonal();
  const Eigen::Matrix3d unknown = Eigen::Vector3d(1e4, 1e4, 10.0).asDiagonal();
  std::vector<ChainRow> rows;
  for (std::uint32_t k = 0; k < 5; ++k) rows.push_back({k, k + 1, {1.0, 0.0, 0.0}, k == 2 ? unknown : sure});
  const std::vector<bool> ends{true, false, false, false, false, true};
  const TrackChains chains(rows, ends);
  EXPECT_TRUE(chains.is_kept(2));
  EXPECT_TRUE(chains.is_kept(3));
  EXPECT_FALSE(chains.is_kept(1));
  EXPECT_EQ(chains.rows().size(), 3U);
  rows[2].covariance = sure;
  EXPECT_EQ(TrackChains(rows, ends).rows().size(), 1U);
}

// Landmarks wrong by 1 cm must not bend what the scan matcher held together: what is looked at is the shape of each
// sub-map, its far end seen from its first key-frame.
TEST(FinalGraph, LandmarksOffByACentimetreDoNotBendSubmaps) {
  double worst = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    SimulatedRunOptions options;
    options.seed = seed;
    options.step_sigma_m = options.step_sigma_rad = 0.0;
    const SimulatedRun run(ring_path(160.0, 0.7), options);
    TrackGraph graph = build_track_graph(model_of(run));
    const auto before = graph.track;
    ASSERT_TRUE(solve_track_graph(graph));
    for (std::size_t k = 0; k + 1 < graph.first_of_submap.size(); ++k) {
      const std::size_t first = graph.first_of_submap[k];
      const std::size_t last = std::min(graph.track.size() - 1, first + 65);
      const Pose2 shape = between(before[first].map_from_base, before[last].map_from_base);
      const Pose2 bent = between(graph.track[first].map_from_base, graph.track[last].map_from_base);
      worst = std::max(worst, (shape.translation() - bent.translation()).norm());
    }
  }
  std::printf("worst bend of a 20 m sub-map under 1 cm landmark noise: %.1f mm\n", 1e3 * worst);
  EXPECT_LT(worst, 0.015);
}

TEST(FinalGraph, TooManyLandmarksAreThinnedAndStayWorthAsMuch) {
  GraphModel model = model_of(SimulatedRun(ring_path(160.0, 1.0), {}));
  const auto information = [](const TrackGraph& graph) {
    double sum = 0.0;
    for (const auto& row : graph.sights) sum += row.covariance.inverse().trace();
    return sum;
  };
  const double of_all = information(build_track_graph(model));
  const std::size_t rows = build_track_graph(model).sights.size();
  constexpr std::size_t kCopies = 2000;
  for (ChainLink& link : model.links) {
    const std::vector<VirtualLandmark> once = link.landmarks;
    for (std::size_t k = 1; k < kCopies; ++k) link.landmarks.insert(link.landmarks.end(), once.begin(), once.end());
  }
  const TrackGraph thinned = build_track_graph(model);
  EXPECT_GT(rows * kCopies, 100'000U);
  EXPECT_LT(thinned.sights.size(), 26'000U);
  EXPECT_GT(thinned.sights.size(), 12'000U);
  EXPECT_NEAR(information(thinned), static_cast<double>(kCopies) * of_all, 1e-6 * of_all * kCopies);
}

TEST(FinalGraph, PlainSquaresBendTheTrackToALandmarkThatMoved) {
  const GraphModel model = model_of(SimulatedRun(ring_path(160.0, 1.0), {}));
  GraphModel spoilt = model;
  spoilt.links[3].landmarks[0].in_b.x() += 2.0;
  const auto moved_by = [&](bool robust_loss) {
    TrackGraph right = build_track_graph(model);
    TrackGraph wrong = build_track_graph(spoilt);
    EXPECT_TRUE(solve_track_graph(right, robust_loss));
    EXPECT_TRUE(solve_track_graph(wrong, robust_loss));
    return largest_move(right.track, wrong.track);
  };
  const double robust_m = moved_by(true);
  const double plain_m = moved_by(false);
  std::printf("a landmark 2 m off moves the track by %.4f m, with plain squares by %.4f m\n", robust_m, plain_m);
  EXPECT_LT(robust_m, 0.1 * plain_m);
}

TEST(FinalGraph, ALoopMayBeOneEdge) {
  const SimulatedRun run(ring_path(160.0, 2.0), {});
  GraphModel model = model_of(run);
  const TrackGraph open = build_track_graph(model);
  constexpr std::uint32_t kLapLater = 16;
  LoopRecord record;
  record.loop.match = run.refine(*run.submaps()[0], *run.submaps()[kLapLater]);
  record.loop.match.a = 0;
  record.loop.match.b = kLapLater;
  record.loop.state = LoopState::kConfirmed;
  record.landmarks = run.landmarks(*run.submaps()[0], *run.submaps()[kLapLater], record.loop.match);
  model.loops.push_back(record);
  const TrackGraph with_rows = build_track_graph(model);
  EXPECT_EQ(with_rows.chain.size(), open.chain.size());
  EXPECT_EQ(with_rows.sights.size(), open.sights.size() + 2 * record.landmarks.size());
  model.parts.landmark_rows = false;
  TrackGraph graph = build_track_graph(model);
  EXPECT_EQ(graph.chain.size(), open.chain.size() + 1);
  EXPECT_EQ(graph.sights.size(), open.sights.size());
  ASSERT_TRUE(solve_track_graph(graph));
  const Pose2 a_from_b = between(graph.track[graph.first_of_submap[0]].map_from_base,
                                 graph.track[graph.first_of_submap[kLapLater]].map_from_base);
  EXPECT_LT(between(record.loop.match.a_from_b, a_from_b).translation().norm(), 0.1);
}

TEST(FinalGraph, ExportHoldsTogether) {
  SimulatedRunOptions options;
  options.breaks = {5};
  const SimulatedRun run(ring_path(160.0, 1.0), options);
  TrackGraph graph = build_track_graph(model_of(run));
  ASSERT_TRUE(solve_track_graph(graph));
  const GraphExport out = export_graph(graph);
  std::map<std::uint64_t, Pose2> poses;
  std::map<std::uint64_t, Eigen::Vector2d> points;
  for (const GraphPose& vertex : out.poses) EXPECT_TRUE(poses.emplace(vertex.id, vertex.pose).second) << vertex.id;
  for (const GraphPoint& vertex : out.points) {
    EXPECT_TRUE(points.emplace(vertex.id, vertex.point).second) << vertex.id;
    EXPECT_EQ(poses.count(vertex.id), 0U) << "ids of different kinds collide";
  }
  double chi2 = 0.0;
  std::set<std::uint64_t> tied;
  for (const GraphPoseEdge& edge : out.pose_edges) {
    ASSERT_EQ(poses.count(edge.from) + poses.count(edge.to), 2U);
    const Pose2 off = between(edge.measurement, between(poses[edge.from], poses[edge.to]));
    const Eigen::Vector3d e(off.x, off.y, off.yaw);
    chi2 += e.dot(edge.information * e);
    tied.insert({edge.from, edge.to});
  }
  for (const GraphPointEdge& edge : out.point_edges) {
    ASSERT_EQ(poses.count(edge.from) + points.count(edge.to), 2U);
    const Eigen::Vector2d e = transform(inverse(poses[edge.from]), points[edge.to]) - edge.measurement;
    chi2 += e.dot(edge.information * e);
    tied.insert(edge.to);
  }
  EXPECT_TRUE(std::isfinite(chi2));
  EXPECT_GT(chi2, 0.0);
  EXPECT_EQ(tied.size(), poses.size() + points.size()) << "every vertex hangs on an edge";
  ASSERT_EQ(out.fixed.size(), 1U);
  EXPECT_EQ(out.fixed[0], track_point_id(0));
}

}  // namespace
}  // namespace submapd::graph
