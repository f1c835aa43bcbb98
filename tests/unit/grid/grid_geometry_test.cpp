#include "slam/grid/grid_geometry.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <limits>

#include "slam/grid/index_map.hpp"

namespace submapd {
namespace {

TEST(CellAtTest, NegativeCoordinatesFloorAndDoNotTruncate) {
  EXPECT_EQ(cell_at(0.0, 0.0, 20.0), (CellIndex{kMapBias, kMapBias}));
  EXPECT_EQ(cell_at(0.049, -0.001, 20.0), (CellIndex{kMapBias, kMapBias - 1}));
  EXPECT_EQ(cell_at(-0.05, -0.0501, 20.0), (CellIndex{kMapBias - 1, kMapBias - 2}));
}

TEST(CellAtTest, BlockAndMapBorders) {
  const CellIndex last{63, 63};
  const CellIndex first_of_next{64, 64};
  EXPECT_EQ(block_of(last), 0);
  EXPECT_EQ(offset_of(last), kBlockArea - 1);
  EXPECT_EQ(block_of(first_of_next), kDirectoryBlocks + 1);
  EXPECT_EQ(offset_of(first_of_next), 0);
  EXPECT_EQ(block_of({64, 63}), 1);
  EXPECT_EQ(offset_of({64, 63}), 63 * kBlockCells);

  const double half_m = kMapBias / 20.0;
  EXPECT_TRUE(in_map(cell_at(-half_m, -half_m, 20.0)));
  EXPECT_EQ(cell_at(-half_m, -half_m, 20.0), (CellIndex{0, 0}));
  EXPECT_TRUE(in_map(cell_at(half_m - 1e-6, half_m - 1e-6, 20.0)));
  EXPECT_EQ(block_of(cell_at(half_m - 1e-6, half_m - 1e-6, 20.0)), kDirectorySize - 1);
  EXPECT_FALSE(in_map(cell_at(half_m, 0.0, 20.0)));
  EXPECT_FALSE(in_map(cell_at(0.0, half_m, 20.0)));
  EXPECT_FALSE(in_map(cell_at(-half_m - 1e-6, 0.0, 20.0)));
  EXPECT_FALSE(in_map(cell_at(0.0, -half_m - 1e-6, 20.0)));
}

TEST(CellAtTest, HugeAndNotFiniteLieOutside) {
  const double inf = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {1e7, -1e7, 1e300, -1e300, std::numeric_limits<double>::max(), inf, -inf, nan}) {
    EXPECT_FALSE(in_map(cell_at(bad, 0.0, 20.0))) << bad;
    EXPECT_FALSE(in_map(cell_at(0.0, bad, 20.0))) << bad;
  }
}

RC_GTEST_PROP(CellAtTest, BlockAndOffsetNameTheCell, ()) {
  const CellIndex c{*rc::gen::inRange(0, kMapCells), *rc::gen::inRange(0, kMapCells)};
  const int block = block_of(c);
  const int offset = offset_of(c);
  RC_ASSERT(block >= 0 && block < kDirectorySize && offset >= 0 && offset < kBlockArea);
  RC_ASSERT((block % kDirectoryBlocks) * kBlockCells + offset % kBlockCells == c.ix);
  RC_ASSERT((block / kDirectoryBlocks) * kBlockCells + offset / kBlockCells == c.iy);
  // The centre of the cell is in the cell.
  RC_ASSERT(cell_at((c.ix - kMapBias + 0.5) * 0.05, (c.iy - kMapBias + 0.5) * 0.05, 20.0) == c);
}

TEST(OccupancyProbabilityTest, KnownValues) {
  const OccupancyOptions o;
  EXPECT_DOUBLE_EQ(occupancy_probability(0, 0, o), 0.5);
  // L / (1 + L) literally, where it does not overflow.
  for (int hits = 0; hits < 12; ++hits) {
    for (int misses = 0; misses < 12; ++misses) {
      const double odds = std::pow(o.odds_hit, hits) * std::pow(o.odds_free, misses);
      EXPECT_NEAR(occupancy_probability(static_cast<std::uint64_t>(hits), static_cast<std::uint64_t>(misses), o),
                  odds / (1.0 + odds), 1e-12);
    }
  }
  EXPECT_NEAR(occupancy_probability(1, 0, o), 0.69970, 1e-5);
  EXPECT_NEAR(occupancy_probability(0, 1, o), 0.40120, 1e-5);
}

TEST(OccupancyProbabilityTest, FiniteAtAnyCount) {
  const OccupancyOptions o;
  for (const std::uint64_t n : {std::uint64_t{1'000'000}, std::uint64_t{1'000'000'000}, ~std::uint64_t{0}}) {
    const double occupied = occupancy_probability(n, 0, o);
    const double free = occupancy_probability(0, n, o);
    EXPECT_GT(occupied, 0.999999);
    EXPECT_LT(occupied, 1.0);
    EXPECT_LT(free, 1e-6);
    EXPECT_GT(free, 0.0);
    EXPECT_TRUE(std::isfinite(occupancy_probability(n, n, o)));
  }
}

RC_GTEST_PROP(OccupancyProbabilityTest, SymmetricForReciprocalOdds, ()) {
  OccupancyOptions o;
  o.odds_hit = 2.0;
  o.odds_free = 0.5;
  const auto hits = *rc::gen::inRange<std::uint64_t>(0, 500);
  const auto misses = *rc::gen::inRange<std::uint64_t>(0, 500);
  RC_ASSERT(std::abs(occupancy_probability(hits, misses, o) + occupancy_probability(misses, hits, o) - 1.0) < 1e-12);
}

RC_GTEST_PROP(OccupancyProbabilityTest, RisesWithHitsAndFallsWithMisses, ()) {
  const OccupancyOptions o;
  const auto hits = *rc::gen::inRange<std::uint64_t>(0, 20);  // within the clamp, where it is strict
  const auto misses = *rc::gen::inRange<std::uint64_t>(0, 40);
  const double p = occupancy_probability(hits, misses, o);
  RC_ASSERT(occupancy_probability(hits + 1, misses, o) > p);
  RC_ASSERT(occupancy_probability(hits, misses + 1, o) < p);
  const auto many = *rc::gen::inRange<std::uint64_t>(0, 1'000'000'000);
  RC_ASSERT(occupancy_probability(hits + many, misses, o) >= p);
  RC_ASSERT(occupancy_probability(hits, misses + many, o) <= p);
}

}  // namespace
}  // namespace submapd
