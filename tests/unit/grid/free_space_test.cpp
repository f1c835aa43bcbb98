#include "slam/grid/free_space.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <array>
#include <numbers>
#include <set>

namespace submapd {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kCell_m = 0.05;

struct Vector {
  double x = 0.0;
  double y = 0.0;
};

BeamEnd beam(Vector origin, double angle, double range, bool hit = true) {
  BeamEnd end;
  end.x = static_cast<float>(origin.x + range * std::cos(angle));
  end.y = static_cast<float>(origin.y + range * std::sin(angle));
  end.range_m = static_cast<float>(range);
  end.hit = hit;
  return end;
}

using Cells = std::set<std::pair<int, int>>;

// The cells of the spans; fails if a cell comes twice, a row descends or a span leaves the map.
Cells cells_of(std::span<const RowSpan> spans) {
  Cells cells;
  int row = -1;
  for (const RowSpan& s : spans) {
    EXPECT_GE(s.iy, row);
    row = s.iy;
    EXPECT_TRUE(in_map({s.ix_begin, s.iy}) && in_map({s.ix_end - 1, s.iy}) && s.ix_begin < s.ix_end);
    for (int ix = s.ix_begin; ix < s.ix_end; ++ix) EXPECT_TRUE(cells.insert({ix, s.iy}).second) << ix << " " << s.iy;
  }
  return cells;
}

Vector centre_of(int ix, int iy) {
  return {(ix - kMapBias + 0.5) * kCell_m, (iy - kMapBias + 0.5) * kCell_m};
}

// Signed distances of p to the three sides of a triangle, by its orientation; all positive: inside.
std::array<double, 3> side_distances(Vector p, Vector a, Vector b, Vector c) {
  const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
  const double sign = area < 0.0 ? -1.0 : 1.0;
  const auto side = [&](Vector s, Vector e) {
    const double length = std::max(std::hypot(e.x - s.x, e.y - s.y), 1e-12);
    return sign * ((e.x - s.x) * (p.y - s.y) - (e.y - s.y) * (p.x - s.x)) / length;
  };
  return {side(a, b), side(b, c), side(c, a)};
}

// The rule of design notes 4.4 by its definition: one triangle a pair of neighbours. +1 inside, -1 outside, 0 too close
// to a side of a triangle to tell in single precision.
int by_definition(Vector p, Vector origin, const std::vector<BeamEnd>& beams, const FreeSpaceOptions& options) {
  int verdict = -1;
  for (std::size_t i = 0; i + 1 < beams.size(); ++i) {
    std::array<double, 2> reach{};
    for (std::size_t k = 0; k < 2; ++k) {
      const BeamEnd& b = beams[i + k];
      const double r = static_cast<double>(b.range_m);
      reach[k] = std::min(b.hit ? r - options.pull_back_cells * kCell_m : r, options.max_range_m);
    }
    if (reach[0] <= 0.0 || reach[1] <= 0.0) continue;
    if (std::abs(reach[0] - reach[1]) > options.edge_jump_m) reach[0] = reach[1] = std::min(reach[0], reach[1]);
    std::array<Vector, 2> end;
    for (std::size_t k = 0; k < 2; ++k) {
      const BeamEnd& b = beams[i + k];
      const double s = reach[k] / static_cast<double>(b.range_m);
      end[k] = {origin.x + s * (static_cast<double>(b.x) - origin.x),
                origin.y + s * (static_cast<double>(b.y) - origin.y)};
    }
    const auto d = side_distances(p, origin, end[0], end[1]);
    const double low = std::min({d[0], d[1], d[2]});
    if (std::abs(low) < 2e-4) return 0;
    if (low > 0.0) verdict = 1;
  }
  return verdict;
}

TEST(FreeSpaceTest, SquareRoomInClosedForm) {
  // From the middle of a square of half side a, pulled back by t along each ray: area 4 a^2 - 8 a asinh(1) t + pi t^2.
  const double a = 2.0;
  const Vector origin{0.013, -0.021};
  std::vector<BeamEnd> beams;
  for (int i = 0; i <= 1440; ++i) {
    const double angle = i * kPi / 720.0;
    beams.push_back(beam(origin, angle, a / std::max(std::abs(std::cos(angle)), std::abs(std::sin(angle)))));
  }
  FreeSpacePolygon polygon({}, kCell_m, 2048);
  const Cells cells = cells_of(polygon.convert(static_cast<float>(origin.x), static_cast<float>(origin.y), beams));
  const double t = 1.5 * kCell_m;
  const double area = 4.0 * a * a - 8.0 * a * std::asinh(1.0) * t + kPi * t * t;
  EXPECT_NEAR(static_cast<double>(cells.size()) * kCell_m * kCell_m, area, 0.01 * area);
  for (int iy = kMapBias - 50; iy < kMapBias + 50; ++iy) {
    for (int ix = kMapBias - 50; ix < kMapBias + 50; ++ix) {
      const Vector c = centre_of(ix, iy);
      const double dx = c.x - origin.x;
      const double dy = c.y - origin.y;
      const double r = std::hypot(dx, dy);
      const double wall = r * a / std::max({std::abs(dx), std::abs(dy), 1e-9});
      if (r < wall - t - 0.002) {
        EXPECT_TRUE(cells.contains({ix, iy})) << c.x << " " << c.y;
      }
      if (r > wall - t + 0.002) {
        EXPECT_FALSE(cells.contains({ix, iy})) << c.x << " " << c.y;
      }
    }
  }
}

// Ranges that jump, stop short of the pull-back, miss and reach beyond the clip, seen from anywhere in a cell.
RC_GTEST_PROP(FreeSpaceTest, EqualsTheTrianglesOfItsDefinition, ()) {
  FreeSpaceOptions options;
  options.max_range_m = 2.0;
  const Vector origin{*rc::gen::inRange(-200, 200) * 0.0013, *rc::gen::inRange(-200, 200) * 0.0017};
  std::vector<BeamEnd> beams;
  const int n = *rc::gen::inRange(2, 40);
  const double first = *rc::gen::inRange(0, 628) * 0.01;
  double range = 1.0;
  for (int i = 0; i < n; ++i) {
    const int kind = *rc::gen::inRange(0, 10);
    if (kind < 5) range = std::clamp(range + *rc::gen::inRange(-9, 10) * 0.03, 0.1, 2.6);
    if (kind == 5) range = *rc::gen::inRange(1, 280) * 0.01;
    beams.push_back(beam(origin, first + i * 1.5 * kPi / (n < 4 ? 6 : n - 1), kind == 6 ? 0.0 : range, kind != 7));
  }
  FreeSpacePolygon polygon(options, kCell_m, 64);
  // Only single precision reaches the polygon.
  const Vector seen{static_cast<double>(static_cast<float>(origin.x)),
                    static_cast<double>(static_cast<float>(origin.y))};
  const Cells cells = cells_of(polygon.convert(static_cast<float>(origin.x), static_cast<float>(origin.y), beams));
  for (int iy = kMapBias - 60; iy < kMapBias + 60; ++iy) {
    for (int ix = kMapBias - 60; ix < kMapBias + 60; ++ix) {
      const int expected = by_definition(centre_of(ix, iy), seen, beams, options);
      if (expected != 0) {
        RC_ASSERT(cells.contains({ix, iy}) == (expected > 0));
      }
    }
  }
}

TEST(FreeSpaceTest, NeighboursThatJumpTakeTheShorterRange) {
  const Vector origin{};
  const std::vector<BeamEnd> beams{beam(origin, 0.0, 4.0), beam(origin, 0.2, 4.0), beam(origin, 0.4, 2.0),
                                   beam(origin, 0.6, 2.0)};
  FreeSpacePolygon polygon({}, kCell_m, 16);
  const Cells cells = cells_of(polygon.convert(0.0F, 0.0F, beams));
  const auto free_at = [&](double angle, double range) {
    const CellIndex c = cell_at(range * std::cos(angle), range * std::sin(angle), 1.0 / kCell_m);
    return cells.contains({c.ix, c.iy});
  };
  EXPECT_TRUE(free_at(0.1, 3.5));
  EXPECT_TRUE(free_at(0.3, 1.7));
  EXPECT_FALSE(free_at(0.3, 2.2));  // behind the edge
  EXPECT_FALSE(free_at(0.25, 2.5));
  EXPECT_TRUE(free_at(0.5, 1.7));
  EXPECT_FALSE(free_at(0.5, 2.2));
}

TEST(FreeSpaceTest, BeamsWithoutEvidenceGiveNothing) {
  const Vector origin{};
  FreeSpacePolygon polygon({}, kCell_m, 16);
  const std::vector<BeamEnd> none(10);
  EXPECT_TRUE(polygon.convert(0.0F, 0.0F, none).empty());
  EXPECT_TRUE(polygon.convert(0.0F, 0.0F, {}).empty());
  const std::vector<BeamEnd> one{beam(origin, 0.3, 2.0)};
  EXPECT_TRUE(polygon.convert(0.0F, 0.0F, one).empty());
  const std::vector<BeamEnd> hole{beam(origin, 0.0, 2.0), beam(origin, 0.2, 2.0), BeamEnd{}, beam(origin, 0.6, 2.0),
                                  beam(origin, 0.8, 2.0)};
  const Cells cells = cells_of(polygon.convert(0.0F, 0.0F, hole));
  int inside = 0;
  for (const auto& [ix, iy] : cells) {
    const Vector c = centre_of(ix, iy);
    const double angle = std::atan2(c.y, c.x);
    EXPECT_TRUE(angle <= 0.201 || angle >= 0.599) << angle;
    ++inside;
  }
  EXPECT_NEAR(inside * kCell_m * kCell_m, 2 * 0.5 * std::sin(0.2) * 1.925 * 1.925, 0.05);
}

TEST(FreeSpaceTest, ClipsAtTheRangeAndAtTheMapBorder) {
  FreeSpaceOptions options;
  options.max_range_m = 3.0;
  FreeSpacePolygon polygon(options, kCell_m, 512);
  const double border = kMapBias * kCell_m;
  for (const Vector origin : {Vector{0.0, 0.0},
                              {border - 1.0, border - 0.5},
                              {-border + 0.02, 3.0},
                              {border + 1.0, 0.0},
                              {0.0, -border - 20.0}}) {
    std::vector<BeamEnd> beams;
    for (int i = 0; i <= 360; ++i) beams.push_back(beam(origin, i * kPi / 180.0, 25.0, i % 2 == 0));
    const Cells cells = cells_of(polygon.convert(static_cast<float>(origin.x), static_cast<float>(origin.y), beams));
    for (int iy = 0; iy < kMapCells; ++iy) {
      if (std::abs(centre_of(0, iy).y - origin.y) > 3.2) continue;
      for (int ix = 0; ix < kMapCells; ++ix) {
        const Vector c = centre_of(ix, iy);
        const double r = std::hypot(c.x - origin.x, c.y - origin.y);
        if (r < 2.998) {
          EXPECT_TRUE(cells.contains({ix, iy}));
        }
        if (r > 3.001) {
          EXPECT_FALSE(cells.contains({ix, iy}));
        }
      }
    }
  }
}

TEST(FreeSpaceTest, BeamsBeyondTheLimitAreIgnored) {
  const Vector origin{};
  std::vector<BeamEnd> beams;
  for (int i = 0; i < 20; ++i) beams.push_back(beam(origin, i * 0.1, 2.0));
  FreeSpacePolygon small({}, kCell_m, 10);
  FreeSpacePolygon large({}, kCell_m, 64);
  const std::vector<BeamEnd> first(beams.begin(), beams.begin() + 10);
  EXPECT_EQ(cells_of(small.convert(0.0F, 0.0F, beams)), cells_of(large.convert(0.0F, 0.0F, first)));
}

}  // namespace
}  // namespace submapd
