// Particles in their fixed pools: what runs out is counted, what is released comes back, what is baked is the
// survivor's.
#include "slam/filter/particle_set.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <memory>
#include <vector>

#include "slam/base/random.hpp"

namespace submapd {
namespace {

constexpr double kCell_m = 0.05;

struct Baked {
  Pose2 pose;
  std::uint64_t scan_index = 0;
  friend bool operator==(const Baked&, const Baked&) = default;
};

struct Rig {
  DistanceLayers layers;
  int base;
  std::vector<Baked> baked;
  ParticleSet set;
  std::uint64_t next_scan = 0;

  Rig(const ParticleSetOptions& options, int planes)
      : layers(planes, options.max_particles + 2),
        base(layers.create()),
        set(options, layers, kCell_m, [this](const Pose2& pose, const KeyframeScan& scan) {
          baked.push_back({pose, scan.scan.index});
          EXPECT_EQ(scan.scan.ranges_mm,
                    std::vector<std::uint16_t>(3, static_cast<std::uint16_t>(scan.scan.index + 10)))
              << "another scan than was put in";
        }) {}

  // A scan with three hits about the pose of every particle; particles stand apart by `apart`.
  void insert(double apart = 0.1) {
    double y = 0.0;
    for (Particle& p : set.particles()) {
      p.pose = {0.2 * static_cast<double>(next_scan), y, 0.0};
      y += apart;
    }
    Scan scan;
    scan.index = next_scan++;
    scan.ranges_mm.assign(3, static_cast<std::uint16_t>(scan.index + 10));
    const std::vector<BeamEnd> beams = {{2.0F, 0.0F, 2.0F, true}, {0.0F, 2.0F, 2.0F, true}, {-1.0F, 0.0F, 1.0F, true}};
    set.insert_keyframe(scan, {}, beams, {0.0F, 0.0F}, Eigen::Matrix3d::Identity(), false);
  }
};

ParticleSetOptions small_options() {
  ParticleSetOptions options;
  options.max_particles = 6;
  options.max_nodes = 200;
  options.max_scans = 40;
  options.max_beams = 16;
  return options;
}

TEST(ParticleSetTest, OneParticleBakesAtOnce) {
  Rig rig(small_options(), 50);
  for (int k = 0; k < 100; ++k) rig.insert();
  ASSERT_EQ(rig.baked.size(), 100U);
  for (std::size_t k = 0; k < 100; ++k) EXPECT_EQ(rig.baked[k], (Baked{{0.2 * static_cast<double>(k), 0.0, 0.0}, k}));
  EXPECT_EQ(rig.set.forced_coalescences(), 0U);
}

TEST(ParticleSetTest, SpreadParticlesBakeTheHeaviestLineageInOrderAndReleaseTheirLayers) {
  Rig rig(small_options(), 200);
  rig.insert();
  const int free_before = rig.layers.free_planes();
  rig.set.spread(6, rig.base);
  ASSERT_EQ(rig.set.size(), 6U);
  for (int k = 0; k < 5; ++k) rig.insert();
  EXPECT_EQ(rig.baked.size(), 1U) << "nothing is agreed on";
  EXPECT_LT(rig.layers.free_planes(), free_before) << "the layers hold their own key-frames";
  rig.set.particles()[3].log_weight = 1.0;
  rig.set.coalesce();
  ASSERT_EQ(rig.set.size(), 1U);
  EXPECT_EQ(rig.layers.free_planes(), free_before);
  ASSERT_EQ(rig.baked.size(), 6U);
  double y = 0.0;
  for (int i = 0; i < 3; ++i) y += 0.1;
  for (std::size_t k = 1; k < 6; ++k) EXPECT_EQ(rig.baked[k], (Baked{{0.2 * static_cast<double>(k), y, 0.0}, k}));
  EXPECT_EQ(rig.set.particles()[0].layer, -1);
  EXPECT_EQ(rig.set.tree().live_nodes(), 1);
  EXPECT_EQ(rig.set.forced_coalescences(), 0U) << "nothing ran out";
}

TEST(ParticleSetTest, AParticleThatStaysAloneKeepsTheBaseMapAndLeaksNoLayer) {
  Rig rig(small_options(), 200);
  const int free_before = rig.layers.free_planes();
  for (int round = 0; round < 20; ++round) {
    rig.set.spread(1, rig.base);
    ASSERT_EQ(rig.set.size(), 1U);
    ASSERT_EQ(rig.set.particles()[0].layer, -1);
    rig.insert();
    rig.set.coalesce();
    ASSERT_EQ(rig.layers.free_planes(), free_before);
  }
  rig.set.spread(6, rig.base);
  EXPECT_EQ(rig.set.size(), 6U);
}

TEST(ParticleSetTest, SpreadsAsFarAsTheLayersGo) {
  for (int taken = 0; taken <= 7; ++taken) {
    Rig rig(small_options(), 200);  // 8 layers, one of them the base
    std::vector<int> others;
    for (int k = 0; k < taken; ++k) others.push_back(rig.layers.create());
    rig.set.spread(6, rig.base);
    const std::size_t expected = taken >= 6 ? 1U : std::min<std::size_t>(6, static_cast<std::size_t>(7 - taken));
    EXPECT_EQ(rig.set.size(), expected) << taken;
    rig.insert();
    rig.set.coalesce();
    for (int k = taken; k < 7; ++k) EXPECT_GE(rig.layers.create(), 0) << "every layer is free again";
  }
}

TEST(ParticleSetTest, ResamplingToOneAncestorBakesItsLineage) {
  Rig rig(small_options(), 200);
  rig.set.spread(4, rig.base);
  rig.insert();
  rig.insert();
  rig.set.resample(std::vector<int>{2, 2, 2, 2});
  ASSERT_EQ(rig.set.size(), 4U);
  rig.insert();
  EXPECT_EQ(rig.baked, (std::vector<Baked>{{{0.0, 0.2, 0.0}, 0}, {{0.2, 0.2, 0.0}, 1}}));
}

TEST(ParticleSetTest, RunningOutOfScansSettlesTheOldestDisagreement) {
  ParticleSetOptions options = small_options();
  options.max_scans = 3;
  Rig rig(options, 500);
  rig.set.spread(4, rig.base);
  rig.insert();
  rig.set.resample(std::vector<int>{0, 1, 1, 1});  // particles 1 to 3 share their first key-frame
  for (int k = 0; k < 2; ++k) rig.insert();
  EXPECT_EQ(rig.set.forced_coalescences(), 0U);
  EXPECT_TRUE(rig.baked.empty());
  rig.insert();
  EXPECT_EQ(rig.set.forced_coalescences(), 1U);
  EXPECT_EQ(rig.set.size(), 4U) << "the winners take the places of the others";
  EXPECT_EQ(rig.baked.size(), 1U) << "only the oldest is settled";
  EXPECT_EQ(rig.set.pending_keyframes(), 3);
}

TEST(ParticleSetTest, RunningOutOfScansWithoutCommonPastBakesOneLineage) {
  ParticleSetOptions options = small_options();
  options.max_scans = 5;
  Rig rig(options, 500);
  rig.set.spread(4, rig.base);
  for (int k = 0; k < 5; ++k) rig.insert();
  EXPECT_EQ(rig.set.forced_coalescences(), 0U);
  EXPECT_EQ(rig.set.size(), 4U);
  rig.insert();
  EXPECT_EQ(rig.set.forced_coalescences(), 1U);
  EXPECT_EQ(rig.set.size(), 4U);
  EXPECT_EQ(rig.baked.size(), 5U) << "nothing is lost";
}

TEST(ParticleSetTest, RunningOutOfNodesCoalescesExactlyThen) {
  ParticleSetOptions options = small_options();
  options.max_nodes = 1 + 3 * 4;
  Rig rig(options, 500);
  rig.set.spread(4, rig.base);
  for (int k = 0; k < 3; ++k) rig.insert();
  EXPECT_EQ(rig.set.tree().live_nodes(), options.max_nodes);
  EXPECT_EQ(rig.set.forced_coalescences(), 0U);
  rig.insert();
  EXPECT_EQ(rig.set.forced_coalescences(), 1U);
  EXPECT_EQ(rig.set.size(), 1U);
  EXPECT_EQ(rig.baked.size(), 4U);
}

TEST(ParticleSetTest, RunningOutOfPlanesCoalesces) {
  Rig rig(small_options(), 8);
  rig.set.spread(6, rig.base);
  const int free_before = rig.layers.free_planes();
  rig.insert();  // six layers need more than eight planes
  EXPECT_EQ(rig.set.forced_coalescences(), 1U);
  EXPECT_EQ(rig.set.size(), 1U);
  EXPECT_EQ(rig.baked.size(), 1U);
  EXPECT_EQ(rig.layers.free_planes(), free_before);
}

TEST(ParticleSetTest, ResetReturnsEverything) {
  Rig rig(small_options(), 200);
  const int free_before = rig.layers.free_planes();
  const std::size_t bytes_before = rig.set.bytes_used();
  rig.set.spread(6, rig.base);
  for (int k = 0; k < 5; ++k) rig.insert();
  rig.set.reset({1.0, 2.0, 3.0}, {});
  EXPECT_EQ(rig.layers.free_planes(), free_before);
  EXPECT_EQ(rig.set.bytes_used(), bytes_before);
  EXPECT_EQ(rig.set.size(), 1U);
  for (int k = 0; k < 100; ++k) rig.insert();
  EXPECT_EQ(rig.baked.size(), 100U);
}

RC_GTEST_PROP(ParticleSetTest, EveryKeyframeIsBakedOnceInOrderWithinTheBounds, ()) {
  ParticleSetOptions options = small_options();
  options.max_nodes = 30;
  options.max_scans = 8;
  Rig rig(options, 40);
  const int free_before = rig.layers.free_planes();
  const auto steps = *rc::gen::container<std::vector<int>>(50, rc::gen::inRange(0, 7));
  for (const int step : steps) {
    const auto n = static_cast<int>(rig.set.size());
    if (step <= 3) {
      rig.insert();
    } else if (step == 4 && n == 1) {
      rig.set.spread(*rc::gen::inRange(1, 9), rig.base);
    } else if (step == 5 && n > 1) {
      rig.set.resample(*rc::gen::container<std::vector<int>>(static_cast<std::size_t>(n), rc::gen::inRange(0, n)));
    } else if (step == 6) {
      rig.set.coalesce();
    }
    RC_ASSERT(static_cast<int>(rig.set.size()) <= options.max_particles);
    RC_ASSERT(rig.set.bytes_used() <= rig.set.bytes_limit());
    RC_ASSERT(rig.set.tree().live_nodes() <= options.max_nodes);
  }
  rig.set.coalesce();
  RC_ASSERT(rig.baked.size() == rig.next_scan);
  for (std::size_t k = 0; k < rig.baked.size(); ++k) RC_ASSERT(rig.baked[k].scan_index == k);
  RC_ASSERT(rig.layers.free_planes() == free_before);
}

}  // namespace
}  // namespace submapd
