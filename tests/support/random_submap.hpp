// Finished sub-maps with random but legal values, for tests of what carries and stores them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "slam/base/random.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

struct SubmapSizes {
  std::size_t keyframes = 3;
  std::size_t beams = 20;
  std::size_t blocks = 2;
  std::size_t surface = 10;
};

// The same sub-map for the same seed, id and sizes. REQUIRES: at least one key-frame.
inline FinishedSubmap random_submap(std::uint64_t seed, const SubmapId& id, const SubmapSizes& sizes = {}) {
  CounterRandom random(seed, id.index, 0x7375626d6170);
  const auto real = [&random] { return random.uniform(-50.0, 50.0); };
  const auto small = [&random] { return static_cast<std::uint16_t>(random.next_u64() & 0xFFFF); };
  const auto pose = [&real] { return Pose2{real(), real(), real()}; };

  FinishedSubmap submap;
  submap.id = id;
  submap.odom_from_submap = pose();
  submap.reason = static_cast<FinishReason>(random.next_u64() % 9);
  submap.cell_m = random.uniform(0.01, 0.2);
  submap.linked_to_previous = random.uniform() < 0.5;
  std::int64_t stamp_us = 1'600'000'000'000'000 + id.index * std::int64_t{20'000'000};
  std::uint64_t scan_index = id.index * std::uint64_t{1000};
  for (std::size_t i = 0; i < sizes.keyframes; ++i) {
    Keyframe keyframe;
    keyframe.scan_index = scan_index += 1 + random.next_u64() % 9;
    keyframe.stamp_us = stamp_us += 25'000;
    if (i > 0) keyframe.pose = pose();
    keyframe.twist = {real(), real(), real()};
    for (int k = 0; k < 9; ++k) keyframe.step_covariance(k / 3, k % 3) = std::abs(real());
    keyframe.degenerate = random.uniform() < 0.5;
    keyframe.geometry.sweep_s = random.uniform(0.0, 0.1);
    keyframe.geometry.base_from_sensor = pose();
    for (std::size_t beam = 0; beam < sizes.beams; ++beam) keyframe.ranges_mm.push_back(small());
    submap.keyframes.push_back(keyframe);
  }
  for (std::size_t i = 0; i < sizes.blocks; ++i) {
    OccupancyBlock block;
    block.bx = static_cast<std::int32_t>(i % 3) - 1;
    block.by = static_cast<std::int32_t>(i / 3) - 1;
    for (std::uint8_t& cell : block.cells) cell = static_cast<std::uint8_t>(random.next_u64() & 0xFF);
    submap.blocks.push_back(block);
  }
  for (std::size_t i = 0; i < sizes.surface; ++i) {
    SurfacePoint point;
    point.x = static_cast<float>(real());
    point.y = static_cast<float>(real());
    if (random.uniform() < 0.7) {
      const double angle = real();
      point.normal_x = static_cast<float>(std::cos(angle));
      point.normal_y = static_cast<float>(std::sin(angle));
    }
    point.sigma_m = static_cast<float>(random.uniform());
    point.hits = small();
    point.keyframes = small();
    point.view_sectors = static_cast<std::uint8_t>(random.next_u64() & 0xFF);
    submap.surface.push_back(point);
  }
  return submap;
}

}  // namespace submapd
