#include "slam/matching/correlative_search.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "tests/unit/matching/synthetic_room.hpp"

namespace submapd {
namespace {

constexpr double kCell_m = 0.05;

// What the search promises, by trying everything: mean K less the loss to the prior, for each angle and offset in
// cells.
struct Exhaustive {
  std::span<const ScanPoint> points;
  DistanceView field;
  Pose2 centre;
  CorrelativeOptions options;
  double yaw_step;
  int angles;
  int half_u;
  int half_v;

  Exhaustive(std::span<const ScanPoint> p, double far_range_m, const DistanceView& f, const Pose2& c,
             const SearchWindow& window, const CorrelativeOptions& o)
      : points(p),
        field(f),
        centre(c),
        options(o),
        yaw_step(kCell_m / std::max(far_range_m, 1.0)),
        angles(static_cast<int>(std::ceil(window.half_yaw_rad / yaw_step))),
        half_u(static_cast<int>(std::ceil(window.half_x_m / kCell_m))),
        half_v(static_cast<int>(std::ceil(window.half_y_m / kCell_m))) {}

  struct Offset {
    int angle = 0;
    int u = 0;
    int v = 0;
  };
  [[nodiscard]] double gross(const Offset& at) const {
    const double c = std::cos(centre.yaw + at.angle * yaw_step);
    const double s = std::sin(centre.yaw + at.angle * yaw_step);
    double sum = 0.0;
    for (const ScanPoint& p : points) {
      const auto x = static_cast<double>(p.x);
      const auto y = static_cast<double>(p.y);
      CellIndex cell = cell_at(centre.x + c * x - s * y, centre.y + s * x + c * y, 1.0 / kCell_m);
      cell.ix += at.u;
      cell.iy += at.v;
      const double d = field.at(cell) / 8.0 * kCell_m;
      sum += std::exp(-0.5 * d * d / (options.sigma_m * options.sigma_m));
    }
    return sum / static_cast<double>(points.size());
  }
  [[nodiscard]] double net(const Offset& at) const {
    const auto square = [](int value, int half) {
      return half > 0 ? value * value / static_cast<double>(half * half) : 0.0;
    };
    return gross(at) -
           options.prior_weight * (square(at.u, half_u) + square(at.v, half_v) + square(at.angle, angles)) / 3.0;
  }
  // Largest net score of the offsets that `allowed` lets through.
  [[nodiscard]] double best(const std::function<bool(const Offset&)>& allowed) const {
    double out = -1.0;
    for (int a = -angles; a <= angles; ++a) {
      for (int u = -half_u; u <= half_u; ++u) {
        for (int v = -half_v; v <= half_v; ++v) {
          if (allowed({a, u, v})) out = std::max(out, net({a, u, v}));
        }
      }
    }
    return out;
  }
  [[nodiscard]] Offset offset_of(const Pose2& pose) const {
    return {static_cast<int>(std::lround((pose.yaw - centre.yaw) / yaw_step)),
            static_cast<int>(std::lround((pose.x - centre.x) / kCell_m)),
            static_cast<int>(std::lround((pose.y - centre.y) / kCell_m))};
  }
  [[nodiscard]] bool in_window(const Offset& at) const {
    return std::abs(at.angle) <= angles && std::abs(at.u) <= half_u && std::abs(at.v) <= half_v;
  }
  // Whether an offset is the same peak as another, by the options.
  [[nodiscard]] bool same_peak(const Offset& a, const Offset& b) const {
    const int cells = static_cast<int>(options.peak_distance_m / kCell_m);
    return std::abs(a.angle - b.angle) <= static_cast<int>(options.peak_distance_rad / yaw_step) &&
           std::abs(a.u - b.u) <= cells && std::abs(a.v - b.v) <= cells;
  }
};

constexpr double kFloat = 3e-6;  // the search sums in single precision

// Few points and obstacles: each byte of the field counts, and a bound that is a hair too low loses the best offset.
RC_GTEST_PROP(CorrelativeSearchTest, EqualsTryingEverything, ()) {
  DistanceLayers layers(64, 1);
  const int layer = layers.create();
  const int obstacles = *rc::gen::inRange(1, 10);
  for (int i = 0; i < obstacles; ++i) {
    (void)layers.stamp(layer, {kMapBias + *rc::gen::inRange(-25, 25), kMapBias + *rc::gen::inRange(-25, 25)});
  }
  std::vector<ScanPoint> points(static_cast<std::size_t>(*rc::gen::inRange(1, 8)));
  for (ScanPoint& p : points) {
    p.x = static_cast<float>(*rc::gen::inRange(-1300, 1300)) * 1e-3F;
    p.y = static_cast<float>(*rc::gen::inRange(-1300, 1300)) * 1e-3F;
  }
  const Pose2 centre{*rc::gen::inRange(-50, 50) * 0.011, *rc::gen::inRange(-50, 50) * 0.011,
                     *rc::gen::inRange(-314, 314) * 0.01};
  const SearchWindow window{*rc::gen::inRange(1, 11) * 0.05 - 0.01, *rc::gen::inRange(1, 11) * 0.05 - 0.01,
                            *rc::gen::inRange(0, 6) * 0.06};
  CorrelativeOptions options;
  options.prior_weight = *rc::gen::element(0.0, 0.05);
  options.peak_distance_m = 0.15;
  options.peak_distance_rad = 0.1;
  CorrelativeSearch search(options);
  const double far_range_m = 1.5;
  const CorrelativeResult result = search.search(points, far_range_m, layers.view(layer), kCell_m, centre, window);

  const Exhaustive all(points, far_range_m, layers.view(layer), centre, window, options);
  const auto found = all.offset_of(result.pose);
  RC_ASSERT(all.in_window(found));
  RC_ASSERT(std::abs(all.gross(found) - result.score) < kFloat);
  const double best = all.best([](const Exhaustive::Offset&) { return true; });
  RC_ASSERT(std::abs(all.net(found) - best) < kFloat);

  const double second = all.best([&](const Exhaustive::Offset& o) { return !all.same_peak(o, found); });
  if (result.second_score > 0.0) {
    const auto other = all.offset_of(result.second_pose);
    RC_ASSERT(all.in_window(other));
    RC_ASSERT(!all.same_peak(other, found));
    RC_ASSERT(std::abs(all.gross(other) - result.second_score) < kFloat);
    RC_ASSERT(std::abs(all.net(other) - second) < kFloat);
  } else {
    RC_ASSERT(second <= 0.5 * best + kFloat);
  }
}

// Found by EqualsTryingEverything (seed 5, 877th case): stored distances are rounded at both ends, so those of two
// cells may differ by a whole unit more than the cells' distance; a bound that allowed for half a unit lost the best
// offset.
TEST(CorrelativeSearchTest, BoundAllowsForTheRoundingOfBothCells) {
  DistanceLayers layers(64, 1);
  const int layer = layers.create();
  for (const CellIndex c : {CellIndex{-19, -7}, {-12, -14}, {-25, -18}, {-25, -25}}) {
    (void)layers.stamp(layer, {kMapBias + c.ix, kMapBias + c.iy});
  }
  std::vector<ScanPoint> points(3);
  points[0].x = points[0].y = -1300 * 1e-3F;
  points[1].x = -253 * 1e-3F;
  points[1].y = -476 * 1e-3F;
  points[2].x = -938 * 1e-3F;
  points[2].y = -984 * 1e-3F;
  CorrelativeOptions options;
  options.prior_weight = 0.0;
  CorrelativeSearch search(options);
  const Pose2 centre{0.0, -32 * 0.011, -85 * 0.01};
  const SearchWindow window{0.04, 0.04, 3 * 0.06};
  const CorrelativeResult result = search.search(points, 1.5, layers.view(layer), kCell_m, centre, window);
  const Exhaustive all(points, 1.5, layers.view(layer), centre, window, options);
  EXPECT_NEAR(result.score, all.best([](const Exhaustive::Offset&) { return true; }), kFloat);
}

struct SeenRoom {
  World world = furnished_room();
  RoomMap map{world, tour()};
  Pose2 truth{0.37, -0.22, 0.41};
  std::vector<ScanPoint> points = exact_scan(world, truth, 181);
};

const SeenRoom& seen_room() {
  static const SeenRoom kRoom;
  return kRoom;
}

TEST(CorrelativeSearchTest, FindsTheTruthInARoom) {
  const auto& [world, map, truth, points] = seen_room();
  CorrelativeSearch search({});
  for (const auto& [x, y, yaw] : {Pose2{0.45, -0.3, 0.3}, Pose2{-0.45, 0.4, -0.3}, Pose2{0.0, 0.0, 0.0}}) {
    const Pose2 centre{truth.x + x, truth.y + y, truth.yaw + yaw};
    const CorrelativeResult result = search.search(points, 5.0, map.field(), kCell_m, centre, {0.5, 0.5, 0.35});
    EXPECT_NEAR(result.pose.x, truth.x, 0.04);
    EXPECT_NEAR(result.pose.y, truth.y, 0.04);
    EXPECT_NEAR(result.pose.yaw, truth.yaw, 0.012);
    EXPECT_GT(result.score, 0.8);
    EXPECT_LT(result.second_score, 0.75 * result.score);
  }
}

TEST(CorrelativeSearchTest, ASymmetricRoomHasASecondPeak) {
  World world;
  add_box(world, -4.0, -3.0, 4.0, 3.0);
  const RoomMap map(world, tour());
  const Pose2 truth{0.1, -0.05, 0.3};
  const std::vector<ScanPoint> points = exact_scan(world, truth, 181);
  CorrelativeSearch search({});
  const CorrelativeResult result =
      search.search(points, 5.0, map.field(), kCell_m, {0.05, 0.0, 0.2}, {0.3, 0.3, std::numbers::pi + 0.2});
  EXPECT_GT(result.score, 0.8);
  EXPECT_GT(result.second_score, 0.9 * result.score);
  const auto is_at = [](const Pose2& pose, double x, double y, double yaw) {
    return std::abs(pose.x - x) < 0.08 && std::abs(pose.y - y) < 0.08 && std::abs(wrap_angle(pose.yaw - yaw)) < 0.03;
  };
  const double turned = 0.3 + std::numbers::pi;
  EXPECT_TRUE(is_at(result.pose, 0.1, -0.05, 0.3)) << result.pose.x << " " << result.pose.y << " " << result.pose.yaw;
  EXPECT_TRUE(is_at(result.second_pose, -0.1, 0.05, turned)) << result.second_pose.x << " " << result.second_pose.yaw;
}

TEST(CorrelativeSearchTest, ALeastScoreLosesNothingThatHasIt) {
  const auto& [world, map, truth, points] = seen_room();
  CorrelativeSearch search({});
  const Pose2 centre{0.1, 0.1, 0.3};
  SearchWindow window{0.5, 0.5, 0.35};
  const CorrelativeResult all = search.search(points, 5.0, map.field(), kCell_m, centre, window);
  window.least_score = 0.8 * all.score;
  const CorrelativeResult some = search.search(points, 5.0, map.field(), kCell_m, centre, window);
  EXPECT_EQ(some.pose, all.pose);
  EXPECT_EQ(some.score, all.score);
  window.least_score = all.score;
  EXPECT_EQ(search.search(points, 5.0, map.field(), kCell_m, centre, window).score, 0.0);
}

// With few nodes the angles get coarser, but the window stays whole: its last angles too.
TEST(CorrelativeSearchTest, CoarseAnglesCoverTheWholeWindow) {
  const auto& [world, map, truth, points] = seen_room();
  CorrelativeOptions options;
  options.max_nodes = 100;  // four a angle: 25 angles
  CorrelativeSearch search(options);
  for (const double side : {-1.0, 1.0}) {
    const Pose2 centre{truth.x, truth.y, truth.yaw + side * 0.175};
    const CorrelativeResult result = search.search(points, 5.0, map.field(), kCell_m, centre, {0.3, 0.3, 0.175});
    EXPECT_NEAR(result.pose.yaw, truth.yaw, 0.01) << side;
    EXPECT_NEAR(result.pose.x, truth.x, 0.06) << side;
    EXPECT_NEAR(result.pose.y, truth.y, 0.06) << side;
  }
}

TEST(CorrelativeSearchTest, NothingToMatch) {
  DistanceLayers layers(4, 1);
  const int layer = layers.create();
  CorrelativeSearch search({});
  const Pose2 centre{1.0, 2.0, 3.0};
  const CorrelativeResult none = search.search({}, 5.0, layers.view(layer), kCell_m, centre, {});
  EXPECT_EQ(none.pose, centre);
  EXPECT_EQ(none.score, 0.0);
  const std::vector<ScanPoint> points(5);
  const CorrelativeResult empty = search.search(points, 5.0, layers.view(layer), kCell_m, centre, {});
  EXPECT_EQ(empty.pose, centre);  // only the prior speaks
  EXPECT_LT(empty.score, 1e-5);
}

}  // namespace
}  // namespace submapd
