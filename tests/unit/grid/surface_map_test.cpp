#include "slam/grid/surface_map.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd {
namespace {

constexpr double kPi = std::numbers::pi;

// Hits along the wall n . p = offset with normal noise, n = (cos, sin)(angle), seen from the side n points to.
std::vector<SurfaceHit> wall(double angle, double offset, double sigma, int hits, double half_length,
                             std::uint64_t seed) {
  CounterRandom random(seed, 1, 2);
  std::vector<SurfaceHit> out;
  const double nx = std::cos(angle);
  const double ny = std::sin(angle);
  for (int i = 0; i < hits; ++i) {
    const double along = random.uniform(-half_length, half_length);
    const double across = offset + sigma * random.gaussian();
    out.push_back({static_cast<float>(nx * across - ny * along),
                   static_cast<float>(ny * across + nx * along),
                   {static_cast<float>(nx), static_cast<float>(ny)}});
  }
  return out;
}

// Mean and normal of the pooled line near (x, y) against the wall: within five standard errors of the closed form
// (mean across: sigma / sqrt n; angle: sigma / (sqrt n * spread along)).
void expect_line(const SurfaceMap& map, double x, double y, double angle, double offset, double sigma) {
  const double nx = std::cos(angle);
  const double ny = std::sin(angle);
  const PooledLine* line =
      map.find(static_cast<float>(x), static_cast<float>(y), {static_cast<float>(nx), static_cast<float>(ny)});
  ASSERT_NE(line, nullptr) << x << " " << y;
  ASSERT_EQ(line->kind, SurfaceKind::kLine) << x << " " << y;
  const double n = static_cast<double>(line->count);
  const double spread = static_cast<double>(line->half_length_m);
  ASSERT_GT(n, 20.0);
  const double mx = static_cast<double>(line->mean_x);
  const double my = static_cast<double>(line->mean_y);
  const double turn = std::asin(nx * static_cast<double>(line->normal_y) - ny * static_cast<double>(line->normal_x));
  EXPECT_GT(nx * static_cast<double>(line->normal_x) + ny * static_cast<double>(line->normal_y), 0.99);
  EXPECT_NEAR(turn, 0.0, 5.0 * sigma / (std::sqrt(n) * spread) + 1e-4);
  EXPECT_NEAR(nx * mx + ny * my, offset, 5.0 * sigma / std::sqrt(n) + 1e-4);
  EXPECT_NEAR(static_cast<double>(line->sigma_m), sigma, 5.0 * sigma / std::sqrt(2.0 * n) + 1e-4);
}

TEST(SurfaceMapTest, NoisyWallInAndOnTheBorderOfCells) {
  const double sigma = 0.012;
  for (const double offset : {1.05, 1.0, 0.999, 0.93, -0.7}) {  // 1.0 and -0.7: exactly between two rows of cells
    SurfaceMap map(5000, 50);
    map.insert(wall(kPi / 2.0, offset, sigma, 4000, 2.0, 7));
    for (double x = -1.75; x < 1.8; x += 0.1) {
      for (const double beside : {-0.04, 0.0, 0.04}) expect_line(map, x, offset + beside, kPi / 2.0, offset, sigma);
    }
  }
}

RC_GTEST_PROP(SurfaceMapTest, NoisyWallAtAnyAngle, ()) {
  const double angle = *rc::gen::inRange(-314, 315) * 0.01;
  const double offset = *rc::gen::inRange(-300, 301) * 0.01;
  const auto seed = *rc::gen::inRange<std::uint64_t>(0, 1000);
  SurfaceMap map(5000, 50);
  map.insert(wall(angle, offset, 0.01, 1500, 1.0, seed));
  for (const double along : {-0.6, -0.13, 0.0, 0.41}) {
    expect_line(map, std::cos(angle) * offset - std::sin(angle) * along,
                std::sin(angle) * offset + std::cos(angle) * along, angle, offset, 0.01);
  }
  RC_ASSERT(!::testing::Test::HasFailure());
}

TEST(SurfaceMapTest, PooledLinesAreAtMostATenthBehind) {
  SurfaceMap map(5000, 50);
  for (std::uint64_t i = 0; i < 60; ++i) map.insert(wall(kPi / 2.0, 1.05, 0.01, 40, 0.5, i));
  double all = 0.0;  // hits of the 3 x 3 cells around (0.05, 1.05)
  for (const SurfaceFace& face : map.faces()) {
    const int ix = static_cast<int>(face.cell % kSurfaceSide);
    const int iy = static_cast<int>(face.cell / kSurfaceSide);
    if (std::abs(ix - kSurfaceBias) <= 1 && std::abs(iy - kSurfaceBias - 10) <= 1) all += static_cast<double>(face.n);
  }
  const PooledLine* line = map.find(0.05F, 1.05F, {0.0F, 1.0F});
  ASSERT_NE(line, nullptr);
  ASSERT_GT(all, 600.0);
  EXPECT_LE(static_cast<double>(line->count), all);
  EXPECT_GE(static_cast<double>(line->count), all / 1.1 - 1.0);
}

// A door stands back by 12 cm behind a jamb at x = 0.5. Nine cells make one slanted line of the three planes.
TEST(SurfaceMapTest, ACornerKeepsItsTwoWalls) {
  SurfaceMap map(5000, 50);
  for (std::uint64_t i = 0; i < 20; ++i) {
    std::vector<SurfaceHit> hits = wall(kPi / 2.0, 1.06, 0.006, 200, 0.5, 2 * i);  // plain wall, x from -0.5 to 0.5
    CounterRandom random(2 * i + 1, 1, 2);
    for (int k = 0; k < 25; ++k) {
      const double depth = random.uniform(0.0, 0.12);
      hits.push_back(
          {static_cast<float>(0.545 + 0.006 * random.gaussian()), static_cast<float>(1.06 - depth), {0.95F, 0.31F}});
    }
    map.insert(hits);
  }
  const PooledLine* plain = map.find(0.25F, 1.05F, {0.0F, 1.0F});
  ASSERT_NE(plain, nullptr);
  EXPECT_GT(plain->normal_y, 0.999F);
  EXPECT_GT(plain->half_length_m, 0.07F) << "where the wall is straight, all nine cells tell its direction";
  const PooledLine* blended = map.find_pooled(0.45F, 1.05F, {0.6F, 0.8F});
  ASSERT_NE(blended, nullptr);
  EXPECT_LT(std::abs(blended->normal_y), 0.99F) << "else this test shows nothing";
  const PooledLine* beside = map.find(0.45F, 1.05F, {0.6F, 0.8F});
  ASSERT_NE(beside, nullptr);
  EXPECT_GT(beside->normal_y, 0.999F);
}

// A surface of which scans tell the normal, n = (cos, sin)(angle), from `low` to `high` along it.
struct Told {
  double angle;
  double offset;
  double low;
  double high;
  int hits;  // a scan
};

SurfaceMap map_of_twenty_scans(const std::vector<Told>& surfaces) {
  SurfaceMap map(5000, 50);
  for (std::uint64_t scan = 0; scan < 20; ++scan) {
    CounterRandom random(scan, 1, 2);
    std::vector<SurfaceHit> hits;
    for (const Told& surface : surfaces) {
      const double nx = std::cos(surface.angle);
      const double ny = std::sin(surface.angle);
      for (int i = 0; i < surface.hits; ++i) {
        const double along = random.uniform(surface.low, surface.high);
        const double across = surface.offset + 0.01 * random.gaussian();
        const double askew = surface.angle + 0.15 * random.gaussian();
        hits.push_back({static_cast<float>(nx * across - ny * along),
                        static_cast<float>(ny * across + nx * along),
                        {0.71F, 0.71F, static_cast<float>(std::cos(askew)), static_cast<float>(std::sin(askew))}});
      }
    }
    map.insert(hits);
  }
  return map;
}

// A jamb of 6 cm: with noise of 10 mm its scatter says no direction, and the wall beside it shares its cell.
TEST(SurfaceMapTest, AShortJambIsALineBesideItsWall) {
  const SurfaceMap map = map_of_twenty_scans({
      {kPi / 2.0, 1.02, -0.55, 0.0, 60},  // wall along x, at y = 1.02, for x from 0 to 0.55
      {0.0, 0.55, 1.02, 1.08, 6},         // jamb, at x = 0.55, for y from 1.02 to 1.08
  });
  const PooledLine* jamb = map.find(0.55F, 1.05F, {0.71F, 0.71F, 1.0F, 0.0F});
  ASSERT_NE(jamb, nullptr);
  EXPECT_EQ(jamb->kind, SurfaceKind::kLine);
  EXPECT_GT(jamb->normal_x, 0.99F);
  EXPECT_NEAR(jamb->mean_x, 0.55F, 0.004F);
  EXPECT_NEAR(jamb->sigma_m, 0.01F, 0.003F);
  const PooledLine* wall_beside = map.find(0.53F, 1.03F, {0.71F, 0.71F, 0.0F, 1.0F});
  ASSERT_NE(wall_beside, nullptr);
  EXPECT_GT(wall_beside->normal_y, 0.999F);
  EXPECT_NEAR(wall_beside->mean_y, 1.02F, 0.003F) << "not drawn away by the jamb";
  // Whose scan told no normal finds one of the two.
  EXPECT_NE(map.find(0.55F, 1.05F, {0.71F, 0.71F}), nullptr);
}

// A door stands back by 7 cm: nine cells hold two parallel walls, and their scatter a slanted line.
TEST(SurfaceMapTest, AStepIsNotASlope) {
  const SurfaceMap map = map_of_twenty_scans({{kPi / 2.0, 1.02, -0.55, 0.0, 60}, {kPi / 2.0, 1.09, -1.1, -0.55, 60}});
  for (const float x : {0.35F, 0.45F, 0.55F, 0.65F, 0.75F}) {
    for (const float y : {1.03F, 1.08F}) {
      const PooledLine* line = map.find(x, y, {0.71F, 0.71F, 0.0F, 1.0F});
      ASSERT_NE(line, nullptr) << x << " " << y;
      EXPECT_GT(line->normal_y, 0.99F) << x << " " << y;
    }
  }
}

TEST(SurfaceMapTest, AFewAskewNormalsAreNoFace) {
  const SurfaceMap map = map_of_twenty_scans({{kPi / 2.0, 1.05, -1.0, 1.0, 400}, {0.0, 0.45, 1.05, 1.06, 1}});
  EXPECT_EQ(map.find(0.45F, 1.05F, {0.71F, 0.71F, 1.0F, 0.0F}), nullptr);
  EXPECT_NE(map.find(0.45F, 1.05F, {0.71F, 0.71F, 0.0F, 1.0F}), nullptr);
}

TEST(SurfaceMapTest, FewHitsAreNoMorePreciseThanHitsAre) {
  SurfaceMap map(100, 5);
  // Three hits that happen to lie on a line.
  map.insert(std::vector<SurfaceHit>{
      {0.01F, 0.05F, {0.0F, 1.0F}}, {0.05F, 0.05F, {0.0F, 1.0F}}, {0.09F, 0.05F, {0.0F, 1.0F}}});
  const PooledLine* line = map.find(0.05F, 0.05F, {0.0F, 1.0F});
  ASSERT_NE(line, nullptr);
  EXPECT_EQ(line->kind, SurfaceKind::kLine);
  EXPECT_GT(line->sigma_m, 0.008F);
}

TEST(SurfaceMapTest, ThinWallHasTwoFaces) {
  SurfaceMap map(5000, 50);
  const double sigma = 0.005;
  for (std::uint64_t i = 0; i < 10; ++i) {  // the rooms take turns
    map.insert(wall(kPi / 2.0, 1.06, sigma, 400, 1.0, 2 * i));
    map.insert(wall(-kPi / 2.0, -1.03, sigma, 400, 1.0, 2 * i + 1));  // y = 1.03 seen from below
  }
  for (double x = -0.75; x < 0.8; x += 0.1) {
    for (const double y : {1.02, 1.045, 1.07}) {
      expect_line(map, x, y, kPi / 2.0, 1.06, sigma);
      expect_line(map, x, y, -kPi / 2.0, -1.03, sigma);
    }
  }
  // A view along the wall belongs to the first face that was made, whichever: but it finds one.
  EXPECT_NE(map.find(0.05F, 1.05F, {1.0F, 0.0F}), nullptr);
}

TEST(SurfaceMapTest, PoleIsAPoint) {
  SurfaceMap map(5000, 50);
  CounterRandom random(3, 1, 1);
  std::vector<SurfaceHit> hits;
  for (int i = 0; i < 300; ++i) {
    hits.push_back({static_cast<float>(2.05 + 0.02 * random.gaussian()),
                    static_cast<float>(-1.05 + 0.02 * random.gaussian()),
                    {-1.0F, 0.0F}});
  }
  map.insert(hits);
  const PooledLine* pole = map.find(2.05F, -1.05F, {-1.0F, 0.0F});
  ASSERT_NE(pole, nullptr);
  EXPECT_EQ(pole->kind, SurfaceKind::kPoint);
  EXPECT_EQ(pole->normal_x, 0.0F);
  EXPECT_EQ(pole->normal_y, 0.0F);
  EXPECT_NEAR(pole->mean_x, 2.05F, 0.006F);
  EXPECT_NEAR(pole->mean_y, -1.05F, 0.006F);
  EXPECT_NEAR(pole->sigma_m, 0.02F, 0.003F);
  EXPECT_EQ(map.find(2.35F, -1.05F, {-1.0F, 0.0F}), nullptr);
}

TEST(SurfaceMapTest, FewHitsAreNoLine) {
  SurfaceMap map(100, 5);
  map.insert(std::vector<SurfaceHit>{{0.01F, 0.05F, {0.0F, 1.0F}}, {0.09F, 0.05F, {0.0F, 1.0F}}});
  const PooledLine* line = map.find(0.05F, 0.05F, {0.0F, 1.0F});
  ASSERT_NE(line, nullptr);
  EXPECT_EQ(line->kind, SurfaceKind::kPoint);
}

TEST(SurfaceMapTest, ForgetTakesTheCellOutOfItsNeighbours) {
  SurfaceMap map(5000, 50);
  map.insert(wall(kPi / 2.0, 1.05, 0.005, 2000, 1.0, 5));
  const float before = map.find(0.15F, 1.05F, {0.0F, 1.0F})->count;
  map.forget(0.05, 1.05);
  const PooledLine* beside = map.find(0.15F, 1.05F, {0.0F, 1.0F});
  ASSERT_NE(beside, nullptr);
  EXPECT_LT(beside->count, 0.8F * before);
  EXPECT_GT(beside->count, 0.5F * before);
  for (const double x : {-0.05, 0.05, 0.15}) map.forget(x, 1.05);
  EXPECT_EQ(map.find(0.05F, 1.05F, {0.0F, 1.0F}), nullptr);
  EXPECT_NE(map.find(0.25F, 1.05F, {0.0F, 1.0F}), nullptr);
  for (const SurfaceFace& face : map.faces()) {
    const int ix = static_cast<int>(face.cell % kSurfaceSide) - kSurfaceBias;
    const int iy = static_cast<int>(face.cell / kSurfaceSide) - kSurfaceBias;
    if (iy != 10 || ix < -1 || ix > 1) continue;
    EXPECT_EQ(face.n, 0.0F);
    EXPECT_EQ(face.keyframes, 0);
    EXPECT_EQ(face.view_sectors, 0);  // what comes here next was not seen from there
  }
  map.forget(500.0, 0.0);  // outside: nothing
  map.insert(wall(kPi / 2.0, 1.05, 0.005, 2000, 1.0, 6));
  expect_line(map, 0.05, 1.05, kPi / 2.0, 1.05, 0.005);
}

TEST(SurfaceMapTest, FullPoolsRefuseAndCount) {
  SurfaceMap few_faces(20, 50);
  few_faces.insert(wall(kPi / 2.0, 1.05, 0.005, 2000, 3.0, 5));
  EXPECT_GT(few_faces.refused(), 0U);
  EXPECT_LE(few_faces.faces().size(), 20U);
  EXPECT_LE(few_faces.bytes_used(), few_faces.bytes_limit());
  int found = 0;
  for (double x = -2.95; x < 3.0; x += 0.1) {
    if (few_faces.find(static_cast<float>(x), 1.05F, {0.0F, 1.0F}) != nullptr) ++found;
  }
  EXPECT_GT(found, 0);
  SurfaceMap one_block(5000, 1);
  one_block.insert(wall(kPi / 2.0, 1.05, 0.005, 2000, 3.0, 5));  // crosses x = 0, a border of blocks
  EXPECT_GT(one_block.refused(), 0U);
  const bool left = one_block.find(-1.0F, 1.05F, {0.0F, 1.0F}) != nullptr;
  const bool right = one_block.find(1.0F, 1.05F, {0.0F, 1.0F}) != nullptr;
  EXPECT_NE(left, right);
  const std::uint64_t refused = one_block.refused();
  one_block.clear();
  EXPECT_EQ(one_block.refused(), refused);  // counts the run, not the sub-map
  EXPECT_EQ(one_block.find(-1.0F, 1.05F, {0.0F, 1.0F}), nullptr);
  EXPECT_EQ(one_block.find(1.0F, 1.05F, {0.0F, 1.0F}), nullptr);
}

TEST(SurfaceMapTest, KeyframesCountScansAcrossTheWrapOfTheMark) {
  SurfaceMap map(100, 5);
  const std::vector<SurfaceHit> here{{0.05F, 0.05F, {0.0F, 1.0F}}, {0.06F, 0.05F, {0.0F, 1.0F}}};
  const std::vector<SurfaceHit> there{{2.05F, 0.05F, {0.0F, 1.0F}}};
  const auto keyframes_here = [&] {
    for (const SurfaceFace& f : map.faces()) {
      if (f.n > 0.0F && f.cell == static_cast<std::uint32_t>(kSurfaceBias * kSurfaceSide + kSurfaceBias))
        return int{f.keyframes};
    }
    return -1;
  };
  map.insert(here);  // mark 1
  EXPECT_EQ(keyframes_here(), 1);
  for (int i = 0; i < 65534; ++i) map.insert(there);
  map.insert(here);  // mark 1 again
  EXPECT_EQ(keyframes_here(), 2);
  for (const SurfaceFace& f : map.faces()) EXPECT_LE(f.n, 2001.0F);  // inertia is finite
}

TEST(SurfaceMapTest, HitsOutsideAreIgnored) {
  SurfaceMap map(100, 5);
  map.insert(
      std::vector<SurfaceHit>{{1e9F, 0.0F, {0.0F, 1.0F}}, {0.0F, -1e30F, {0.0F, 1.0F}}, {102.35F, 0.0F, {0.0F, 1.0F}}});
  EXPECT_EQ(map.faces().size(), 1U);
  EXPECT_EQ(map.find(1e9F, 0.0F, {0.0F, 1.0F}), nullptr);
}

}  // namespace
}  // namespace submapd
