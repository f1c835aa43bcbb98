#include "slam/grid/distance_layers.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <map>
#include <vector>

#include "tests/unit/grid/brute_force_distance.hpp"

namespace submapd {
namespace {

// A corner of four blocks, or of the map: the cells of a test lie within kSpread of it.
constexpr int kSpread = 12;
constexpr int kReach = kSpread + kDistanceRadiusCells + 2;

CellIndex any_corner() {
  return {*rc::gen::element(0, 64, 2048, 4032, kMapCells), *rc::gen::element(0, 64, 2048, 4032, kMapCells)};
}
CellIndex any_cell_near(CellIndex corner) {
  return {std::clamp(corner.ix + *rc::gen::inRange(-kSpread, kSpread), 0, kMapCells - 1),
          std::clamp(corner.iy + *rc::gen::inRange(-kSpread, kSpread), 0, kMapCells - 1)};
}

// Stored minus true distance over the neighbourhood of the corner, the largest and the smallest.
std::pair<int, int> errors(const DistanceView& view, const CellSet& occupied, CellIndex corner) {
  int highest = -1000;
  int lowest = 1000;
  for (int iy = corner.iy - kReach; iy <= corner.iy + kReach; ++iy) {
    for (int ix = corner.ix - kReach; ix <= corner.ix + kReach; ++ix) {
      const int truth = in_map({ix, iy}) ? brute_force_distance(occupied, {ix, iy}) : int{kDistanceFar};
      const int error = view.at({ix, iy}) - truth;
      highest = std::max(highest, error);
      lowest = std::min(lowest, error);
    }
  }
  return {lowest, highest};
}
constexpr std::pair<int, int> kExact{0, 0};

std::vector<int> blocks_within_reach(CellIndex cell) {
  std::vector<int> blocks;
  for (int by = 0; by < kDirectoryBlocks; ++by) {
    for (int bx = 0; bx < kDirectoryBlocks; ++bx) {
      const int dx = std::max({bx * kBlockCells - cell.ix, cell.ix - (bx * kBlockCells + kBlockCells - 1), 0});
      const int dy = std::max({by * kBlockCells - cell.iy, cell.iy - (by * kBlockCells + kBlockCells - 1), 0});
      if (dx <= kDistanceRadiusCells && dy <= kDistanceRadiusCells) blocks.push_back(by * kDirectoryBlocks + bx);
    }
  }
  return blocks;
}

TEST(DistanceLayersTest, EmptyLayerIsFarEverywhereAndOutside) {
  DistanceLayers layers(4, 1);
  const int layer = layers.create();
  ASSERT_EQ(layer, 0);
  for (const CellIndex c : {CellIndex{0, 0}, {2048, 2048}, {4095, 4095}, {-1, 0}, {0, 4096}, {1'000'000, -1'000'000}}) {
    EXPECT_EQ(layers.view(layer).at(c), kDistanceFar);
  }
  EXPECT_EQ(layers.bytes_used(), 0U);
}

TEST(DistanceLayersTest, KernelValues) {
  DistanceLayers layers(4, 1);
  const int layer = layers.create();
  ASSERT_TRUE(layers.stamp(layer, {2080, 2080}));
  const DistanceView view = layers.view(layer);
  EXPECT_EQ(view.at({2080, 2080}), 0);
  EXPECT_EQ(view.at({2081, 2080}), 8);
  EXPECT_EQ(view.at({2081, 2081}), 11);  // 8 sqrt(2) = 11.3
  EXPECT_EQ(view.at({2083, 2076}), 40);  // 3, 4, 5
  EXPECT_EQ(view.at({2073, 2080}), 56);
  EXPECT_EQ(view.at({2072, 2080}), 64);
  EXPECT_EQ(view.at({2086, 2086}), 64);  // 8.5 cells
  EXPECT_EQ(layers.bytes_used(), std::size_t{kBlockArea});
}

RC_GTEST_PROP(DistanceLayersTest, StampEqualsBruteForce, ()) {
  DistanceLayers layers(16, 1);
  const int layer = layers.create();
  const CellIndex corner = any_corner();
  CellSet occupied;
  const int n = *rc::gen::inRange(1, 12);
  for (int i = 0; i < n; ++i) {
    const CellIndex c = any_cell_near(corner);
    RC_ASSERT(layers.stamp(layer, c));
    occupied.insert({c.ix, c.iy});
  }
  RC_ASSERT(errors(layers.view(layer), occupied, corner) == kExact);
}

RC_GTEST_PROP(DistanceLayersTest, RebuildAfterClearingEqualsBruteForce, ()) {
  DistanceLayers layers(16, 1);
  const int layer = layers.create();
  const CellIndex corner = any_corner();
  CellSet occupied;
  const int n = *rc::gen::inRange(2, 12);
  for (int i = 0; i < n; ++i) {
    const CellIndex c = any_cell_near(corner);
    (void)layers.stamp(layer, c);
    occupied.insert({c.ix, c.iy});
  }
  std::set<int> dirty;
  const int gone = *rc::gen::inRange(1, n + 1);
  for (int i = 0; i < gone && !occupied.empty(); ++i) {
    const auto it = std::next(occupied.begin(), *rc::gen::inRange(0, static_cast<int>(occupied.size())));
    const CellIndex c{it->first, it->second};
    occupied.erase(it);
    layers.clear_occupied(layer, c);
    RC_ASSERT(layers.view(layer).at(c) != 0);
    for (const int block : blocks_within_reach(c)) dirty.insert(block);
    RC_ASSERT(errors(layers.view(layer), occupied, corner).second <= 0);  // too low until rebuilt, never too high
  }
  for (const int block : dirty) RC_ASSERT(layers.rebuild_block(layer, block));
  RC_ASSERT(errors(layers.view(layer), occupied, corner) == kExact);
}

TEST(DistanceLayersTest, DuplicateSharesUntilOneOfThemWrites) {
  DistanceLayers layers(8, 3);
  const int a = layers.create();
  (void)layers.stamp(a, {2080, 2080});  // one block
  (void)layers.stamp(a, {2144, 2080});  // the next one
  ASSERT_EQ(layers.bytes_used(), 2U * kBlockArea);
  const int b = layers.duplicate(a);
  ASSERT_GE(b, 0);
  EXPECT_EQ(layers.bytes_used(), 2U * kBlockArea);
  const int block = block_of({2080, 2080});
  EXPECT_EQ(layers.view(a).plane(block), layers.view(b).plane(block));

  (void)layers.stamp(b, {2090, 2090});
  EXPECT_EQ(layers.bytes_used(), 3U * kBlockArea);
  EXPECT_EQ(layers.view(b).at({2090, 2090}), 0);
  EXPECT_EQ(layers.view(a).at({2090, 2090}), kDistanceFar);
  EXPECT_EQ(layers.view(a).plane(block_of({2144, 2080})), layers.view(b).plane(block_of({2144, 2080})));

  (void)layers.stamp(a, {2144, 2090});  // the original writes: the copy stays
  EXPECT_EQ(layers.bytes_used(), 4U * kBlockArea);
  EXPECT_EQ(layers.view(b).at({2144, 2090}), kDistanceFar);
  layers.clear_occupied(a, {2080, 2080});
  EXPECT_EQ(layers.view(b).at({2080, 2080}), 0);
  EXPECT_EQ(layers.bytes_used(), 4U * kBlockArea);  // nobody shares this plane any more: no copy
  EXPECT_EQ(layers.bytes_peak(), 4U * kBlockArea);
  layers.release(a);
  layers.release(b);
  EXPECT_EQ(layers.bytes_used(), 0U);
  EXPECT_EQ(layers.bytes_peak(), 4U * kBlockArea);
}

TEST(DistanceLayersTest, LayersRunOut) {
  DistanceLayers layers(4, 2);
  const int a = layers.create();
  EXPECT_EQ(layers.duplicate(a), 1);
  EXPECT_EQ(layers.create(), -1);
  EXPECT_EQ(layers.duplicate(a), -1);
  layers.release(a);
  EXPECT_EQ(layers.create(), a);
}

TEST(DistanceLayersTest, FullPoolSaysSoAndLeavesSharedPlanesAlone) {
  DistanceLayers layers(2, 2);  // one plane to give
  const int a = layers.create();
  ASSERT_TRUE(layers.stamp(a, {2080, 2080}));
  const int b = layers.duplicate(a);
  EXPECT_FALSE(layers.stamp(b, {2085, 2080}));
  EXPECT_EQ(layers.view(b).at({2085, 2080}), 40);
  EXPECT_EQ(layers.view(a).at({2085, 2080}), 40);
  EXPECT_FALSE(layers.clear_occupied(b, {2080, 2080}));
  EXPECT_EQ(layers.view(a).at({2080, 2080}), 0);
  EXPECT_FALSE(layers.rebuild_block(b, block_of({2080, 2080})));
  layers.release(a);
  EXPECT_TRUE(layers.stamp(b, {2085, 2080}));  // now its own
  EXPECT_TRUE(layers.clear_occupied(b, {2080, 2080}));
  EXPECT_TRUE(layers.rebuild_block(b, block_of({2080, 2080})));
  EXPECT_EQ(layers.view(b).at({2080, 2080}), 40);
}

// Random duplications, writes and releases against sets of cells and a table of who shares what. With the small pool
// some writes fail: then the field may be too high, never too low.
void check_random_operations(int max_planes, bool may_be_full) {
  struct Model {
    CellSet occupied;
    std::map<int, int> planes;  // block -> plane
  };
  constexpr int kLayers = 4;
  DistanceLayers layers(max_planes, kLayers);
  const CellIndex corner = any_corner();
  std::map<int, Model> model;
  int next_plane = 0;
  const auto write = [&](int layer, int block) {
    Model& m = model[layer];
    int holders = 0;
    const auto it = m.planes.find(block);
    for (const auto& [other, o] : model) {
      const auto p = o.planes.find(block);
      if (it != m.planes.end() && p != o.planes.end() && p->second == it->second) ++holders;
    }
    if (holders != 1) m.planes[block] = next_plane++;
  };
  const int operations = *rc::gen::inRange(5, 40);
  for (int i = 0; i < operations; ++i) {
    const int what = *rc::gen::inRange(0, 10);
    if (what == 0 || model.empty()) {
      const int layer = layers.create();
      RC_ASSERT((layer >= 0) == (model.size() < kLayers));
      if (layer < 0) continue;
      RC_ASSERT(model.count(layer) == 0);
      model[layer] = {};
      continue;
    }
    const int layer = std::next(model.begin(), *rc::gen::inRange(0, static_cast<int>(model.size())))->first;
    if (what <= 2) {
      const int copy = layers.duplicate(layer);
      RC_ASSERT((copy >= 0) == (model.size() < kLayers));
      if (copy >= 0) model[copy] = model[layer];
    } else if (what == 3) {
      layers.release(layer);
      model.erase(layer);
    } else if (what == 4 && !may_be_full && !model[layer].occupied.empty()) {
      const auto [x, y] = *model[layer].occupied.begin();
      model[layer].occupied.erase({x, y});
      RC_ASSERT(layers.clear_occupied(layer, {x, y}));
      write(layer, block_of({x, y}));
      for (const int block : blocks_within_reach({x, y})) {
        RC_ASSERT(layers.rebuild_block(layer, block));
        write(layer, block);
      }
    } else {
      const CellIndex c = any_cell_near(corner);
      const bool complete = layers.stamp(layer, c);
      RC_ASSERT(complete || may_be_full);
      model[layer].occupied.insert({c.ix, c.iy});
      for (const int block : blocks_within_reach(c)) write(layer, block);
    }
  }
  std::set<int> planes;
  for (const auto& [layer, m] : model) {
    for (const auto& [block, plane] : m.planes) planes.insert(plane);
    const auto [lowest, highest] = errors(layers.view(layer), m.occupied, corner);
    RC_ASSERT(lowest >= 0);
    if (!may_be_full) {
      RC_ASSERT(highest == 0);
    }
  }
  if (!may_be_full) {
    RC_ASSERT(layers.bytes_used() == planes.size() * kBlockArea);
  }
  RC_ASSERT(layers.bytes_used() <= layers.bytes_peak());
  RC_ASSERT(layers.bytes_peak() <= layers.bytes_limit());
  for (const auto& [layer, m] : model) layers.release(layer);
  RC_ASSERT(layers.free_planes() == max_planes - 1);
  RC_ASSERT(layers.bytes_used() == 0U);
}

RC_GTEST_PROP(DistanceLayersTest, RandomOperationsMatchTheModel, ()) {
  check_random_operations(64, false);
}
RC_GTEST_PROP(DistanceLayersTest, RandomOperationsOnAFullPoolAreNeverTooLow, ()) {
  check_random_operations(4, true);
}

}  // namespace
}  // namespace submapd
