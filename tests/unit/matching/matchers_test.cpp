#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "slam/base/small_matrix.hpp"
#include "slam/matching/field_matcher.hpp"
#include "slam/matching/line_matcher.hpp"
#include "slam/matching/scan_matcher.hpp"
#include "tests/unit/matching/synthetic_room.hpp"

namespace submapd {
namespace {

constexpr double kDeg = std::numbers::pi / 180.0;
constexpr double kCell_m = 0.05;

const World& room() {
  static const World kInstance = furnished_room();
  return kInstance;
}
const RoomMap& room_map() {
  static const RoomMap kInstance(room(), tour());
  return kInstance;
}

double translation_error(const Pose2& a, const Pose2& b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}
double rotation_error(const Pose2& a, const Pose2& b) {
  return std::abs(wrap_angle(a.yaw - b.yaw));
}

void expect_information(const Eigen::Matrix3d& H) {
  EXPECT_EQ(H, H.transpose());
  const Eigen::Vector3d values = principal_axes(H).values;
  EXPECT_GT(values(0), 0.0);
}

const Pose2 kTruth{0.37, -0.22, 0.41};

TEST(FieldMatcherTest, RecoversAFifthOfAMetreAndFiveDegrees) {
  const std::vector<ScanPoint> points = exact_scan(room(), kTruth);
  FieldMatcherOptions options;
  options.max_iterations = 30;
  for (const double direction : {0.0, 1.1, 2.7, 4.0, 5.5}) {
    for (const double turn : {-5.0 * kDeg, 5.0 * kDeg}) {
      const Pose2 start{kTruth.x + 0.2 * std::cos(direction), kTruth.y + 0.2 * std::sin(direction), kTruth.yaw + turn};
      const MatchResult result = match_field(points, room_map().field(), kCell_m, start, {}, options);
      EXPECT_LT(translation_error(result.pose, kTruth), 0.015) << direction << " " << turn;  // a third of a cell
      EXPECT_LT(rotation_error(result.pose, kTruth), 0.4 * kDeg) << direction << " " << turn;
      EXPECT_GT(result.health.matched_ratio, 0.95);
      EXPECT_LT(result.health.mean_distance_m, 0.03);
      expect_information(result.information);
    }
  }
}

TEST(LineMatcherTest, RecoversThreeCentimetresToTheSubMillimetre) {
  const std::vector<ScanPoint> points = exact_scan(room(), kTruth);
  LineMatcherOptions options;
  options.max_iterations = 20;
  for (const double direction : {0.0, 1.1, 2.7, 4.0, 5.5}) {
    for (const double turn : {-1.0 * kDeg, 1.0 * kDeg}) {
      const Pose2 start{kTruth.x + 0.03 * std::cos(direction), kTruth.y + 0.03 * std::sin(direction),
                        kTruth.yaw + turn};
      const LineMatchResult result = match_lines(points, room_map().map.surface(), kExactStep_rad, start, {}, options);
      EXPECT_LT(translation_error(result.match.pose, kTruth), 0.001) << direction << " " << turn;
      EXPECT_LT(rotation_error(result.match.pose, kTruth), 0.01 * kDeg) << direction << " " << turn;
      EXPECT_GT(result.match.health.line_ratio, 0.9);
      expect_information(result.match.information);
    }
  }
}

TEST(ScanMatcherTest, BothStagesWithNoise) {
  const RoomMap noisy(room(), tour(), 0.012);
  double worst_m = 0.0;
  double worst_rad = 0.0;
  for (std::uint64_t i = 0; i < 20; ++i) {
    CounterRandom random(5, i, 0);
    ScanPoints points({}, 1081);
    points.assign(noisy_scan(room(), kTruth, 0.012, random), {});
    const Pose2 start{kTruth.x + random.uniform(-0.1, 0.1), kTruth.y + random.uniform(-0.1, 0.1),
                      kTruth.yaw + random.uniform(-0.05, 0.05)};
    const MatchResult result = match_scan(points, noisy.field(), noisy.map, start, {}, {});
    worst_m = std::max(worst_m, translation_error(result.pose, kTruth));
    worst_rad = std::max(worst_rad, rotation_error(result.pose, kTruth));
    EXPECT_GT(result.health.line_ratio, 0.8);
  }
  std::printf("worst of 20: %.2f mm, %.3f deg\n", 1e3 * worst_m, worst_rad / kDeg);
  EXPECT_LT(worst_m, 0.004);
  EXPECT_LT(worst_rad, 0.08 * kDeg);
}

TEST(ScanMatcherTest, StageTwoMayNotJump) {
  CounterRandom random(5, 1, 0);
  ScanPoints points({}, 1081);
  points.assign(noisy_scan(room(), kTruth, 0.0, random), {});
  ScanMatcherOptions options;
  options.max_line_shift_m = 0.0;
  const MatchResult fenced = match_scan(points, room_map().field(), room_map().map, kTruth, {}, options);
  options.use_lines = false;
  const MatchResult field_only = match_scan(points, room_map().field(), room_map().map, kTruth, {}, options);
  EXPECT_EQ(fenced.pose, field_only.pose);
  EXPECT_EQ(fenced.information, field_only.information);
  EXPECT_GT(fenced.health.line_ratio, 0.8);
  EXPECT_EQ(field_only.health.line_ratio, 0.0);
}

// A corridor along x, mapped and seen without its ends.
struct Corridor {
  World world{{-200.0, -1.02, 200.0, -1.02}, {-200.0, 1.03, 200.0, 1.03}};
  RoomMap map{world, walk()};
  static std::vector<Pose2> walk() {  // dense enough that the rows of cells have no gaps
    std::vector<Pose2> poses;
    for (int i = -30; i <= 30; ++i) poses.push_back({0.21 * i, 0.1 * (i % 3), i % 2 == 0 ? 0.0 : std::numbers::pi});
    return poses;
  }
  // The part of a scan well inside what is mapped: no frontier.
  [[nodiscard]] std::vector<ScanPoint> scan(const Pose2& pose) const {
    std::vector<ScanPoint> points = exact_scan(world, pose);
    std::erase_if(points, [](const ScanPoint& p) { return p.range_m > 5.0F; });
    return points;
  }
};

TEST(CorridorTest, PriorHoldsTheAxisThatNobodySees) {
  const Corridor corridor;
  const Pose2 truth{0.0, 0.05, 0.02};
  const std::vector<ScanPoint> points = corridor.scan(truth);
  MotionPrior prior;
  prior.pose = {0.07, 0.05, 0.02};  // wrong along the axis, and nobody can know
  prior.information = Eigen::Vector3d(100.0, 100.0, 100.0).asDiagonal();
  const Pose2 start{0.07, 0.08, 0.03};
  const MatchResult field = match_field(points, corridor.map.field(), kCell_m, start, prior, {});
  EXPECT_NEAR(field.pose.x, 0.07, 0.01);
  EXPECT_NEAR(field.pose.y, truth.y, 0.015);
  const LineMatchResult lines =
      match_lines(points, corridor.map.map.surface(), kExactStep_rad, {0.07, 0.06, 0.022}, prior, {});
  EXPECT_NEAR(lines.match.pose.x, 0.07, 0.002);
  EXPECT_NEAR(lines.match.pose.y, truth.y, 0.001);
  EXPECT_NEAR(lines.match.pose.yaw, truth.yaw, 0.0005);
  // From elsewhere on the axis it is the prior that draws, and only as far as it goes.
  const LineMatchResult drawn =
      match_lines(points, corridor.map.map.surface(), kExactStep_rad, {0.0, 0.06, 0.022}, prior, {});
  EXPECT_NEAR(drawn.match.pose.x, 0.07, 0.01);
}

TEST(CorridorTest, InformationAlongTheAxisIsNearZero) {
  const Corridor corridor;
  const Pose2 truth{0.0, 0.05, 0.0};
  const LineSystem system =
      line_system(corridor.scan(truth), corridor.map.map.surface(), kExactStep_rad, truth, {}, {});
  const Eigen::Matrix3d& H = system.equations.H;
  EXPECT_GT(system.associated, 200);
  EXPECT_LT(H(0, 0), 1e-3 * H(1, 1));
  const Eigen::Vector2d values = principal_axes(Eigen::Matrix2d(H.topLeftCorner<2, 2>())).values;
  EXPECT_LT(values(0) / values(1), 1e-3);
  const LineSystem in_room =
      line_system(exact_scan(room(), kTruth), room_map().map.surface(), kExactStep_rad, kTruth, {}, {});
  const Eigen::Vector2d held = principal_axes(Eigen::Matrix2d(in_room.equations.H.topLeftCorner<2, 2>())).values;
  EXPECT_GT(held(0) / held(1), 0.1);
}

// The corridor's end, three metres ahead of where it is seen from.
TEST(CorridorTest, OnlyWhatFacesAWeakAxisSpeaksAlongIt) {
  const Pose2 truth{0.0, 0.05, 0.01};
  const Eigen::Vector2d along = Eigen::Vector2d::UnitX();
  const Corridor blank;
  const LineSystem nothing =
      line_system(blank.scan(truth), blank.map.map.surface(), kExactStep_rad, truth, {along}, {});
  EXPECT_EQ(nothing.axial_information, 0.0);
  EXPECT_EQ(nothing.equations.H(0, 0), 0.0) << "normals that are a little off count nothing along the axis";
  EXPECT_GT(nothing.equations.H(1, 1), 1e5);

  const World closed{{-200.0, -1.02, 3.0, -1.02}, {-200.0, 1.03, 3.0, 1.03}, {3.0, -1.02, 3.0, 1.03}};
  std::vector<Pose2> walk;
  for (int i = -30; i <= 0; ++i) walk.push_back({0.1 * i, 0.1 * (i % 3), 0.0});
  const RoomMap map(closed, walk);
  std::vector<ScanPoint> points = exact_scan(closed, truth);
  std::erase_if(points, [](const ScanPoint& p) { return p.range_m > 5.0F; });
  MotionPrior prior;
  prior.pose = {0.03, 0.05, 0.01};
  prior.information = Eigen::Vector3d(100.0, 100.0, 100.0).asDiagonal();
  prior.weak = {along};
  const LineSystem end = line_system(points, map.map.surface(), kExactStep_rad, prior.pose, {along}, {});
  EXPECT_GT(end.axial_information, 1e5);
  const LineMatchResult found = match_lines(points, map.map.surface(), kExactStep_rad, prior.pose, prior, {});
  EXPECT_NEAR(found.match.pose.x, truth.x, 0.002);
  EXPECT_NEAR(found.match.pose.y, truth.y, 0.002);

  std::vector<ScanPoint> people = points;
  for (ScanPoint& p : people) p.alone = true;
  EXPECT_EQ(line_system(people, map.map.surface(), kExactStep_rad, prior.pose, {along}, {}).axial_information, 0.0);

  LineMatcherOptions careful;
  careful.standing_scans = 1000;  // more scans than there were: as many as there were must do
  EXPECT_GT(line_system(points, map.map.surface(), kExactStep_rad, prior.pose, {along}, careful).axial_information,
            0.0);
}

TEST(WeakMotionTest, RoundACornerItTurnsAsItGoes) {
  const WeakMotion round{Eigen::Vector2d(0.6, 0.8), 0.07};
  const Pose2 there = round.moved({1.0, 2.0, 0.3}, -0.5);
  EXPECT_DOUBLE_EQ(there.x, 0.7);
  EXPECT_DOUBLE_EQ(there.y, 1.6);
  EXPECT_DOUBLE_EQ(there.yaw, 0.265);
}

TEST(FieldMatcherTest, SaturatedPointsDoNotPull) {
  DistanceLayers layers(16, 1);
  const int layer = layers.create();
  for (int i = 0; i < 40; ++i) (void)layers.stamp(layer, cell_at(i * kCell_m, 1.02, 20.0));
  std::vector<ScanPoint> far(50);
  for (std::size_t i = 0; i < far.size(); ++i) {
    far[i].x = static_cast<float>(i) * 0.04F;
    far[i].y = 0.3F;  // 14 cells off
  }
  const Pose2 start{0.01, 0.02, 0.03};
  const MatchResult nothing = match_field(far, layers.view(layer), kCell_m, start, {}, {});
  EXPECT_EQ(nothing.pose, start);
  EXPECT_EQ(nothing.information, Eigen::Matrix3d::Zero());
  EXPECT_EQ(nothing.health.matched_ratio, 0.0);
  // With as many points near the wall these alone decide.
  std::vector<ScanPoint> near = far;
  for (ScanPoint& p : near) p.y = 0.95F;
  std::vector<ScanPoint> both = near;
  both.insert(both.end(), far.begin(), far.end());
  const MatchResult alone = match_field(near, layers.view(layer), kCell_m, {}, {}, {});
  const MatchResult together = match_field(both, layers.view(layer), kCell_m, {}, {}, {});
  EXPECT_EQ(alone.pose, together.pose);
  EXPECT_GT(alone.pose.y, 0.03);
  EXPECT_NEAR(together.health.matched_ratio, 0.5, 1e-12);
  // Nor do points outside the map.
  for (ScanPoint& p : far) p.x = 1e6F;
  EXPECT_EQ(match_field(far, layers.view(layer), kCell_m, start, {}, {}).pose, start);
  EXPECT_EQ(match_field({}, layers.view(layer), kCell_m, start, {}, {}).pose, start);
}

// One pass without a prior: the step solves (H / kappa) d = -g / kappa, and g is the gradient of sum w d^2 / 2 s^2 with
// w fixed. Read g back from H and the step, and hold both against numeric differences of the residuals.
TEST(FieldMatcherTest, GradientAgreesWithNumericDifferences) {
  const DistanceView field = room_map().field();
  const auto residual = [&](const ScanPoint& p, const Pose2& pose) {  // bilinear, by its definition
    const Eigen::Vector2d w = transform(pose, {static_cast<double>(p.x), static_cast<double>(p.y)});
    const double u = w.x() / kCell_m + kMapBias - 0.5;
    const double v = w.y() / kCell_m + kMapBias - 0.5;
    const int ix = static_cast<int>(std::floor(u));
    const int iy = static_cast<int>(std::floor(v));
    const double fx = u - ix;
    const double fy = v - iy;
    const auto d = [&](int dx, int dy) { return field.at({ix + dx, iy + dy}) / 8.0 * kCell_m; };
    return (1 - fx) * (1 - fy) * d(0, 0) + fx * (1 - fy) * d(1, 0) + (1 - fx) * fy * d(0, 1) + fx * fy * d(1, 1);
  };
  std::vector<ScanPoint> points = exact_scan(room(), kTruth, 181);
  FieldMatcherOptions options;
  options.max_iterations = 1;
  options.stop_m = options.stop_rad = 1e9;  // step once, do not evaluate again
  const double h = 1e-6;
  for (const Pose2& pose : {Pose2{0.40, -0.20, 0.43}, Pose2{0.30, -0.31, 0.38}}) {
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    int matched = 0;
    for (const ScanPoint& p : points) {
      const double d = residual(p, pose);
      if (d >= (8.0 - 0.01) * kCell_m) continue;
      ++matched;
      Eigen::Vector3d J;
      J(0) = (residual(p, {pose.x + h, pose.y, pose.yaw}) - residual(p, {pose.x - h, pose.y, pose.yaw})) / (2 * h);
      J(1) = (residual(p, {pose.x, pose.y + h, pose.yaw}) - residual(p, {pose.x, pose.y - h, pose.yaw})) / (2 * h);
      J(2) = (residual(p, {pose.x, pose.y, pose.yaw + h}) - residual(p, {pose.x, pose.y, pose.yaw - h})) / (2 * h);
      const double weight = 1.0 / (1.0 + d * d / (0.15 * 0.15)) / (0.05 * 0.05);
      H += weight * J * J.transpose();
      g += weight * d * J;
    }
    ASSERT_GT(matched, 100);
    const MatchResult result = match_field(points, field, kCell_m, pose, {}, options);
    const Eigen::Vector3d step(result.pose.x - pose.x, result.pose.y - pose.y, result.pose.yaw - pose.yaw);
    EXPECT_LT((result.information - H).norm(), 1e-3 * H.norm());
    EXPECT_LT((result.information * step + g).norm(), 2e-3 * g.norm());
  }
}

TEST(SolveStepTest, KnownValuesAndWrappedPrior) {
  NormalEquations equations;
  equations.H = Eigen::Vector3d(80.0, 160.0, 8.0).asDiagonal();
  equations.g = Eigen::Vector3d(8.0, -16.0, 0.0);
  EXPECT_LT((solve_step(equations, 8.0, {}, {}) - Eigen::Vector3d(-0.1, 0.1, 0.0)).norm(), 1e-6);
  MotionPrior prior;
  prior.information = Eigen::Vector3d(10.0, 0.0, 1.0).asDiagonal();
  prior.pose = {0.3, 0.0, -std::numbers::pi + 0.1};
  const Eigen::Vector3d step = solve_step(equations, 8.0, {0.0, 0.0, std::numbers::pi - 0.1}, prior);
  EXPECT_NEAR(step(0), (-1.0 + 3.0) / 20.0, 1e-6);
  EXPECT_NEAR(step(2), 0.1, 1e-6);  // a tenth ahead across the seam, half of 0.2
  EXPECT_TRUE(solve_step({}, 8.0, {}, {}).isZero(1e-12));
}

TEST(LikelihoodTableTest, FallsWithDistanceToTheLimit) {
  DistanceLayers layers(16, 1);
  const int layer = layers.create();
  (void)layers.stamp(layer, {kMapBias, kMapBias});
  const LikelihoodTable table({}, kCell_m);
  const auto at = [&](double x) {
    ScanPoint p;
    p.x = static_cast<float>(x);
    p.y = 0.025F;
    return table.log_likelihood(std::span(&p, 1), layers.view(layer), kCell_m, {});
  };
  EXPECT_NEAR(at(0.025), std::log(0.9 + 0.1 * std::exp(-4.5)) / 30.0, 1e-6);
  for (int cells = 0; cells < 7; ++cells) EXPECT_GT(at(0.025 + cells * 0.05), at(0.075 + cells * 0.05)) << cells;
  EXPECT_NEAR(at(0.025 + 9 * 0.05), at(0.025 + 4 * 0.05), 1e-9);  // unknown: half the radius
  EXPECT_NEAR(at(500.0), at(0.025 + 4 * 0.05), 1e-9);
}

TEST(LikelihoodTableTest, PeaksAtTheTruth) {
  const std::vector<ScanPoint> points = exact_scan(room(), kTruth);
  const LikelihoodTable table({}, kCell_m);
  const auto at = [&](double dx, double dy, double turn) {
    return table.log_likelihood(points, room_map().field(), kCell_m, {kTruth.x + dx, kTruth.y + dy, kTruth.yaw + turn});
  };
  const double best = at(0.0, 0.0, 0.0);
  for (int i = 0; i < 12; ++i) {
    const double a = i * std::numbers::pi / 6.0;
    double previous = best;
    for (const double off : {0.05, 0.1, 0.2}) {
      const double here = at(off * std::cos(a), off * std::sin(a), 0.0);
      EXPECT_LT(here, previous) << i << " " << off;
      previous = here;
    }
  }
  for (const double turn : {-6.0, -2.0, 2.0, 6.0}) EXPECT_LT(at(0.0, 0.0, turn * kDeg), best);
}

TEST(KnownFitTest, KnownValues) {
  DistanceLayers layers(64, 2);
  IndexMap map({}, layers);
  // A wall at x = 2 m seen from the origin within 0.5 rad.
  std::vector<BeamEnd> beams;
  for (int i = 0; i <= 400; ++i) {
    const double a = -0.5 + i * 0.0025;
    beams.push_back({2.02F, static_cast<float>(2.02 * std::tan(a)), static_cast<float>(2.02 / std::cos(a)), true});
  }
  for (int i = 0; i < 3; ++i) (void)map.insert(Eigen::Vector2f::Zero(), beams);
  const auto fit_of = [&](std::vector<std::pair<double, double>> ends) {
    Scan scan;  // beams 1 deg apart, from -90 deg
    scan.geometry.first_angle_rad = -90.0 * kDeg;
    scan.geometry.angle_step_rad = kDeg;
    scan.ranges_mm.assign(181, 0);
    for (const auto& [degrees, range] : ends) {
      scan.ranges_mm[static_cast<std::size_t>(90.0 + degrees)] = static_cast<std::uint16_t>(std::lround(1e3 * range));
    }
    ScanPoints points({}, 181);
    points.assign(scan, {});
    return known_fit(points, map.distance(), map, {});
  };
  const KnownFit none = fit_of({});
  EXPECT_EQ(none.known_ratio, 0.0);
  EXPECT_EQ(none.matched_ratio, 1.0);
  EXPECT_EQ(none.contradiction, 0.0);
  // On the wall; 15 cm before it (still near); in the middle of free space; behind the wall; beside everything.
  const KnownFit mixed = fit_of({{0.0, 2.02}, {4.0, 1.9}, {-8.0, 1.0}, {12.0, 3.5}, {80.0, 2.0}});
  EXPECT_NEAR(mixed.known_ratio, 3.0 / 5.0, 1e-12);
  EXPECT_NEAR(mixed.matched_ratio, 2.0 / 3.0, 1e-12);
  EXPECT_NEAR(mixed.contradiction, 1.0 / 3.0, 1e-12);
  const KnownFit unknown = fit_of({{60.0, 2.0}, {80.0, 2.0}});
  EXPECT_EQ(unknown.known_ratio, 0.0);
  EXPECT_EQ(unknown.matched_ratio, 1.0);
}

// Normalised estimation error squared of the matcher without a prior, with the covariance as the mapper takes it
// (kappa = 30); 3 would be honest for it, less says that it is too large.
struct ErrorModel {
  double range_sigma_m = 0.012;  // of each range, in the map and in the scans
  double scan_bias_m = 0.0;      // of all ranges of one scan, standard deviation
  double map_pose_m = 0.0;       // of the poses that made the map
};
double mean_nees(const ErrorModel& model, double& rms_m) {
  constexpr double kMapperKappa = 30.0;
  constexpr int kScans = 200;
  std::vector<Pose2> poses = tour();
  CounterRandom shake(12, 0, 0);
  for (Pose2& p : poses) {
    p.x += model.map_pose_m * shake.gaussian();
    p.y += model.map_pose_m * shake.gaussian();
    p.yaw += 0.3 * model.map_pose_m * shake.gaussian();
  }
  RoomMap map(room(), {});
  map.insert(room(), tour(), poses, model.range_sigma_m, 1);
  double sum = 0.0;
  double square_m = 0.0;
  for (std::uint64_t i = 0; i < kScans; ++i) {
    CounterRandom random(11, i, 0);
    const Pose2 truth{random.uniform(-1.0, 1.0), random.uniform(-0.8, 0.8), random.uniform(-3.0, 3.0)};
    const double bias_mm = 1e3 * model.scan_bias_m * random.gaussian();
    Scan scan = noisy_scan(room(), truth, model.range_sigma_m, random);
    for (std::uint16_t& mm : scan.ranges_mm) mm = static_cast<std::uint16_t>(std::lround(mm + bias_mm));
    ScanPoints points({}, 1081);
    points.assign(scan, {});
    const Pose2 start{truth.x + random.uniform(-0.03, 0.03), truth.y + random.uniform(-0.03, 0.03),
                      truth.yaw + random.uniform(-0.015, 0.015)};
    const MatchResult result = match_scan(points, map.field(), map.map, start, {}, {});
    EXPECT_GT(result.health.line_ratio, 0.5);
    const Eigen::Vector3d off(result.pose.x - truth.x, result.pose.y - truth.y,
                              wrap_angle(result.pose.yaw - truth.yaw));
    sum += off.dot(result.information / kMapperKappa * off);
    square_m += off.head<2>().squaredNorm();
  }
  rms_m = std::sqrt(square_m / kScans);
  return sum / kScans;
}

TEST(ConsistencyTest, IndependentNoiseIsFarBelowTheCovariance) {
  double rms_m = 0.0;
  const double nees = mean_nees({}, rms_m);
  std::printf("independent noise: mean NEES %.3f at kappa 30 (kappa %.1f gives 3), rms %.2f mm\n", nees, 10.0 * nees,
              1e3 * rms_m);
  // Measured 0.095: with nothing but independent noise kappa about 1 would be honest. 30 pays for errors that beams
  // share.
  EXPECT_GT(nees, 0.06);
  EXPECT_LT(nees, 0.15);
  EXPECT_LT(rms_m, 0.0012);
}

TEST(ConsistencyTest, SharedErrorsStayBelowTheCovariance) {
  double rms_m = 0.0;
  const double nees = mean_nees({0.012, 0.010, 0.005}, rms_m);
  std::printf("shared errors: mean NEES %.3f at kappa 30 (kappa %.1f gives 3), rms %.2f mm\n", nees, 10.0 * nees,
              1e3 * rms_m);
  EXPECT_GT(nees, 0.15);
  EXPECT_LT(nees, 4.0);
}

}  // namespace
}  // namespace submapd
