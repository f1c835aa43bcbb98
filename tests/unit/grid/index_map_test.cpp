#include "slam/grid/index_map.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <numbers>

#include "slam/base/random.hpp"
#include "tests/unit/grid/brute_force_distance.hpp"

namespace submapd {
namespace {

constexpr double kCell_m = 0.05;

IndexMapOptions small_options() {
  IndexMapOptions o;
  o.max_blocks = 30;
  o.max_faces = 4000;
  return o;
}

// A fan of beams from the origin over [first, 0.5] rad against a wall at x = wall_m.
std::vector<BeamEnd> fan(double wall_m, int beams = 201, double first = -0.5) {
  std::vector<BeamEnd> out;
  for (int i = 0; i < beams; ++i) {
    const double angle = first + i * (0.5 - first) / (beams - 1);
    BeamEnd end;
    end.x = static_cast<float>(wall_m);
    end.y = static_cast<float>(wall_m * std::tan(angle));
    end.range_m = static_cast<float>(wall_m / std::cos(angle));
    out.push_back(end);
  }
  return out;
}

CellIndex cell(double x, double y) {
  return cell_at(x, y, 1.0 / kCell_m);
}
const Eigen::Vector2f kOrigin = Eigen::Vector2f::Zero();

// Obstacles by the field itself, and whether the field around them is what they say.
CellSet obstacles(const IndexMap& map) {
  CellSet out;
  for (int iy = kMapBias - 100; iy < kMapBias + 100; ++iy) {
    for (int ix = kMapBias - 100; ix < kMapBias + 100; ++ix) {
      if (map.distance().at({ix, iy}) == 0) out.insert({ix, iy});
    }
  }
  return out;
}
void expect_field_of(const IndexMap& map, const CellSet& occupied) {
  int wrong = 0;
  for (int iy = kMapBias - 100; iy < kMapBias + 100; ++iy) {
    for (int ix = kMapBias - 100; ix < kMapBias + 100; ++ix) {
      if (map.distance().at({ix, iy}) != brute_force_distance(occupied, {ix, iy})) ++wrong;
    }
  }
  EXPECT_EQ(wrong, 0);
}

TEST(IndexMapTest, OneCountACellAndScan) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  ASSERT_TRUE(map.insert(kOrigin, fan(1.02, 2001)));  // a hundred beams a cell
  EXPECT_EQ(map.counts(cell(1.02, 0.0)).hits, 1);
  EXPECT_EQ(map.counts(cell(1.02, 0.0)).misses, 0);
  EXPECT_EQ(map.counts(cell(0.5, 0.0)).misses, 1);
  EXPECT_EQ(map.counts(cell(0.1, 0.01)).misses, 1);  // where all beams meet
  EXPECT_EQ(map.counts(cell(0.5, 0.0)).hits, 0);
  for (int i = 0; i < 4; ++i) (void)map.insert(kOrigin, fan(1.02, 2001));
  EXPECT_EQ(map.counts(cell(1.02, 0.0)).hits, 5);
  EXPECT_EQ(map.counts(cell(0.5, 0.0)).misses, 5);
}

TEST(IndexMapTest, HitBeatsFreeInTheSameScan) {
  DistanceLayers layers(64, 2);
  IndexMapOptions options = small_options();
  options.free_space.pull_back_cells = 0.0;
  IndexMap map(options, layers);
  const CellIndex wall = cell(1.04, 0.0);  // its centre, 1.025, lies within the free polygon
  (void)map.insert(kOrigin, fan(1.04));
  EXPECT_EQ(map.counts(wall).hits, 1);
  EXPECT_EQ(map.counts(wall).misses, 0);
  (void)map.insert(kOrigin, fan(1.2));  // now it is only looked through
  EXPECT_EQ(map.counts(wall).hits, 1);
  EXPECT_EQ(map.counts(wall).misses, 1);
}

TEST(IndexMapTest, HalvingKeepsTheRatio) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  const CellIndex wall = cell(1.02, 0.0);
  for (int i = 1; i < 240; ++i) (void)map.insert(kOrigin, fan(1.02, 21));
  EXPECT_EQ(map.counts(wall).hits, 239);
  (void)map.insert(kOrigin, fan(1.02, 21));
  EXPECT_EQ(map.counts(wall).hits, 120);
  // Two hits to one look through, for long: never above the limit, never far from the ratio.
  map.clear();
  for (int i = 0; i < 1500; ++i) {
    (void)map.insert(kOrigin, fan(i % 3 == 2 ? 2.0 : 1.02, 21));
    const IndexMap::Counts c = map.counts(wall);
    ASSERT_LT(c.hits, 240);
    ASSERT_LT(c.misses, 240);
    if (i >= 60) {
      ASSERT_NEAR(static_cast<double>(c.hits) / c.misses, 2.0, 0.11) << i;
    }
  }
}

TEST(IndexMapTest, FreeCountsSaturateAndTheFirstHitHalvesThem) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  const CellIndex inside = cell(1.02, 0.0);
  for (int i = 0; i < 500; ++i) (void)map.insert(kOrigin, fan(2.0, 21));
  EXPECT_EQ(map.counts(inside).misses, 240);
  (void)map.insert(kOrigin, fan(1.02, 21));
  EXPECT_EQ(map.counts(inside).misses, 120);
  EXPECT_NE(map.distance().at(inside), 0);
}

TEST(IndexMapTest, HysteresisBetweenOccupiedAndFree) {
  // log odds: +0.846 a hit, -0.400 a look through; obstacle above 0.619, not one below -0.619.
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  const CellIndex wall = cell(1.02, 0.0);
  const auto is_obstacle = [&] { return map.distance().at(wall) == 0; };
  (void)map.insert(kOrigin, fan(1.02));
  EXPECT_TRUE(is_obstacle());
  for (int misses = 1; misses <= 3; ++misses) {
    (void)map.insert(kOrigin, fan(2.0));
    EXPECT_TRUE(is_obstacle()) << misses;
  }
  (void)map.insert(kOrigin, fan(2.0));
  EXPECT_FALSE(is_obstacle());
  (void)map.insert(kOrigin, fan(1.02));  // +0.09: not yet
  EXPECT_FALSE(is_obstacle());
  (void)map.insert(kOrigin, fan(1.02));  // +0.94
  EXPECT_TRUE(is_obstacle());
}

TEST(IndexMapTest, MovedFurnitureDisappears) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  for (int i = 0; i < 20; ++i) (void)map.insert(kOrigin, fan(1.02));
  const CellSet before = obstacles(map);
  EXPECT_TRUE(before.contains({cell(1.02, 0.0).ix, cell(1.02, 0.0).iy}));
  expect_field_of(map, before);
  ASSERT_NE(map.surface().find(1.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  for (int i = 0; i < 60; ++i) (void)map.insert(kOrigin, fan(2.02));
  const CellSet after = obstacles(map);
  for (const auto& [ix, iy] : after) {
    if (std::abs(iy - kMapBias) < 10) {  // the last cells of the first fan are not in the second
      EXPECT_EQ(ix, cell(2.02, 0.0).ix) << iy;
    }
  }
  EXPECT_GT(after.size(), 35U);
  expect_field_of(map, after);
  EXPECT_EQ(map.surface().find(1.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  EXPECT_NE(map.surface().find(2.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  for (const SurfacePoint& p : map.export_surface()) {
    if (std::abs(p.y) < 0.5F) {
      EXPECT_GT(p.x, 1.9F);
    }
  }
}

TEST(IndexMapTest, WhatCameWhereItWasFreeHasMoved) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  for (int i = 0; i < 6; ++i) (void)map.insert(kOrigin, fan(2.02));
  ASSERT_NE(map.surface().find(2.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  EXPECT_FALSE(map.surface().find(2.02F, 0.02F, {-1.0F, 0.0F})->moved);
  for (int i = 0; i < 3; ++i) (void)map.insert(kOrigin, fan(1.02));  // somebody steps in front of it
  ASSERT_NE(map.surface().find(1.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  EXPECT_TRUE(map.surface().find(1.02F, 0.02F, {-1.0F, 0.0F})->moved);
  for (int i = 0; i < 20; ++i) (void)map.insert(kOrigin, fan(1.02));  // it stays: furniture
  EXPECT_FALSE(map.surface().find(1.02F, 0.02F, {-1.0F, 0.0F})->moved);
}

// The same with random furniture: whatever was cleared and stamped, after the budgeted rebuilds the field is exact.
RC_GTEST_PROP(IndexMapTest, FieldFollowsTheObstacles, ()) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  const int scenes = *rc::gen::inRange(2, 5);
  for (int scene = 0; scene < scenes; ++scene) {
    const double wall = *rc::gen::inRange(8, 40) * 0.1 + 0.02;
    const int scans = *rc::gen::inRange(1, 12);
    for (int i = 0; i < scans; ++i) (void)map.insert(kOrigin, fan(wall, 61));
  }
  for (int i = 0; i < 6; ++i) (void)map.insert(kOrigin, {});  // pays the rebuilds that are due
  const CellSet occupied = obstacles(map);
  int wrong = 0;
  for (int iy = kMapBias - 100; iy < kMapBias + 100; ++iy) {
    for (int ix = kMapBias - 10; ix < kMapBias + 100; ++ix) {
      const IndexMap::Counts c = map.counts({ix, iy});
      const double p = occupancy_probability(c.hits, c.misses, {});
      const bool obstacle = occupied.contains({ix, iy});
      if ((p > 0.651 && !obstacle) || (p < 0.349 && obstacle)) ++wrong;
      if (map.distance().at({ix, iy}) != brute_force_distance(occupied, {ix, iy})) ++wrong;
    }
  }
  RC_ASSERT(wrong == 0);
}

TEST(IndexMapTest, BeyondAHitStaysUnknown) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  for (int i = 0; i < 10; ++i) (void)map.insert(kOrigin, fan(1.02));
  for (double x = 1.06; x < 3.0; x += 0.05) EXPECT_FALSE(map.known(cell(x, 0.0))) << x;
  EXPECT_FALSE(map.known(cell(-0.3, 0.0)));
  EXPECT_TRUE(map.known(cell(1.02, 0.0)));
  EXPECT_TRUE(map.known(cell(0.9, 0.0)));
  EXPECT_FALSE(map.known({-1, 5}));
  EXPECT_FALSE(map.known({kMapCells, 5}));
}

TEST(IndexMapTest, FullPoolsAreCountedAndHarmless) {
  DistanceLayers layers(3, 2);
  IndexMapOptions options = small_options();
  options.max_blocks = 1;
  options.max_faces = 10;
  IndexMap map(options, layers);
  // The fan lies in two blocks (y below and above zero); the one that comes first gets its evidence.
  EXPECT_FALSE(map.insert(kOrigin, fan(1.02)));
  EXPECT_GT(map.refused(), 0U);
  EXPECT_EQ(map.blocks_used(), 1);
  EXPECT_EQ(map.counts(cell(1.02, -0.2)).hits, 1);
  EXPECT_FALSE(map.known(cell(1.02, 0.2)));
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(map.insert(kOrigin, fan(i % 2 == 0 ? 3.0 : 1.02)));
  EXPECT_LE(map.bytes_used(), map.bytes_limit());
  EXPECT_EQ(map.counts(cell(1.02, -0.2)).hits, 11);
  map.clear();
  EXPECT_EQ(map.blocks_used(), 0);
  EXPECT_EQ(layers.bytes_used(), 0U);
}

TEST(IndexMapTest, HitsOutsideTheMapAreCountedNotStored) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  std::vector<BeamEnd> beams = fan(1.02);
  beams[100].x = 1e9F;
  EXPECT_FALSE(map.insert(kOrigin, beams));
  EXPECT_EQ(map.refused(), 1U);
}

TEST(IndexMapTest, AFieldThatCouldNotBeRebuiltIsRebuiltLater) {
  // A particle shares the base map's two planes, and the pool has one more: it goes to the block of the wall that is
  // cleared, while the block below, which holds the end of its field, must wait until the particle is gone.
  DistanceLayers layers(4, 3);
  IndexMap map(small_options(), layers);
  for (int i = 0; i < 3; ++i) (void)map.insert(kOrigin, fan(1.02, 101, 0.01));
  const int particle = layers.duplicate(map.layer());
  ASSERT_EQ(layers.free_planes(), 1);
  const CellIndex below = cell(1.02, -0.13);
  ASSERT_LT(map.distance().at(below), kDistanceFar);
  std::vector<BeamEnd> through = fan(2.5, 101, -0.2);
  for (BeamEnd& b : through) b.hit = false;
  for (int i = 0; i < 20; ++i) (void)map.insert(kOrigin, through);
  EXPECT_NE(map.distance().at(cell(1.02, 0.1)), 0);
  EXPECT_LT(map.distance().at(below), kDistanceFar);
  EXPECT_EQ(layers.view(particle).at(cell(1.02, 0.1)), 0);
  EXPECT_GT(map.refused(), 0U);
  layers.release(particle);
  (void)map.insert(kOrigin, through);
  EXPECT_EQ(map.distance().at(below), kDistanceFar);
  expect_field_of(map, obstacles(map));
}

TEST(IndexMapTest, ClearReallyClears) {
  DistanceLayers layers(64, 2);
  IndexMap used(small_options(), layers);
  IndexMap fresh(small_options(), layers);
  for (int i = 0; i < 10; ++i) (void)used.insert(kOrigin, fan(1.02));
  for (int i = 0; i < 30; ++i) (void)used.insert(kOrigin, fan(2.5));
  used.clear();
  EXPECT_EQ(used.blocks_used(), 0);
  EXPECT_EQ(layers.bytes_used(), 0U);
  EXPECT_TRUE(used.export_blocks().empty());
  EXPECT_TRUE(used.export_surface().empty());
  EXPECT_FALSE(used.known(cell(1.02, 0.0)));
  EXPECT_EQ(used.distance().at(cell(2.52, 0.0)), kDistanceFar);
  EXPECT_EQ(used.surface().find(1.02F, 0.02F, {-1.0F, 0.0F}), nullptr);
  for (int i = 0; i < 3; ++i) {
    (void)used.insert(kOrigin, fan(1.52));
    (void)fresh.insert(kOrigin, fan(1.52));
  }
  const std::vector<OccupancyBlock> a = used.export_blocks();
  const std::vector<OccupancyBlock> b = fresh.export_blocks();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].cells, b[i].cells);
  const std::vector<SurfacePoint> p = used.export_surface();
  const std::vector<SurfacePoint> q = fresh.export_surface();
  ASSERT_EQ(p.size(), q.size());
  for (std::size_t i = 0; i < p.size(); ++i) {
    EXPECT_EQ(p[i].x, q[i].x);
    EXPECT_EQ(p[i].normal_x, q[i].normal_x);
    EXPECT_EQ(p[i].keyframes, q[i].keyframes);
    EXPECT_EQ(p[i].view_sectors, q[i].view_sectors);
  }
}

TEST(IndexMapTest, TheLayerIsGivenBack) {
  DistanceLayers layers(64, 1);
  {
    IndexMap map(small_options(), layers);
    (void)map.insert(kOrigin, fan(1.02));
    EXPECT_EQ(layers.create(), -1);
  }
  EXPECT_EQ(layers.create(), 0);
  EXPECT_EQ(layers.bytes_used(), 0U);
}

TEST(IndexMapTest, ExportIsSortedAndConsistentWithTheCounts) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  for (int i = 0; i < 7; ++i) (void)map.insert(kOrigin, fan(4.52));
  std::vector<BeamEnd> backwards = fan(2.0);
  for (BeamEnd& b : backwards) {
    b.x = -b.x;
    b.y = -b.y;
  }
  (void)map.insert(kOrigin, backwards);
  const std::vector<OccupancyBlock> blocks = map.export_blocks();
  ASSERT_EQ(static_cast<int>(blocks.size()), map.blocks_used());
  ASSERT_GE(blocks.size(), 4U);
  EXPECT_TRUE(std::is_sorted(blocks.begin(), blocks.end(), [](const OccupancyBlock& a, const OccupancyBlock& b) {
    return std::pair(a.by, a.bx) < std::pair(b.by, b.bx);
  }));
  int known = 0;
  for (const OccupancyBlock& block : blocks) {
    for (int o = 0; o < kBlockArea; ++o) {
      const CellIndex c{block.bx * kBlockCells + kMapBias + o % kBlockCells,
                        block.by * kBlockCells + kMapBias + o / kBlockCells};
      const IndexMap::Counts counts = map.counts(c);
      const std::uint8_t stored = block.cells[static_cast<std::size_t>(o)];
      if (!map.known(c)) {
        ASSERT_EQ(stored, 0);
        continue;
      }
      ++known;
      ASSERT_NEAR(stored, cell_of(occupancy_probability(counts.hits, counts.misses, {})), 1);
      ASSERT_NE(stored, 0);
    }
  }
  EXPECT_GT(known, 2000);
}

// The scan mark is a byte and the surfaces' one two: a cell must not take a mark of a whole round ago for today's.
TEST(IndexMapTest, MarksWrapAround) {
  DistanceLayers layers(64, 2);
  IndexMap map(small_options(), layers);
  std::vector<BeamEnd> backwards = fan(1.02, 21);
  for (BeamEnd& b : backwards) b.x = -b.x;
  (void)map.insert(kOrigin, fan(1.02, 21));                             // hit with mark 1
  for (int i = 2; i <= 255; ++i) (void)map.insert(kOrigin, backwards);  // marks 2 .. 255
  (void)map.insert(kOrigin, fan(1.02, 21));                             // mark 1 again
  EXPECT_EQ(map.counts(cell(1.02, 0.0)).hits, 2);
  EXPECT_EQ(map.counts(cell(0.5, 0.0)).misses, 2);
  for (int i = 2; i <= 255; ++i) (void)map.insert(kOrigin, backwards);
  for (int i = 1; i <= 10; ++i) (void)map.insert(kOrigin, fan(1.52, 21));  // a cell free for the first time
  EXPECT_EQ(map.counts(cell(1.2, 0.0)).misses, 10);
  EXPECT_EQ(map.counts(cell(1.02, 0.0)).misses, 10);
}

}  // namespace
}  // namespace submapd
