// What an emulated scanner on the simulated cart sees: the horizontal one the walls, the vertical one walls, floor and
// ceiling beside the cart.
//
// Each beam is cast from the exact pose at its own time. Same world, motion and seed: same ranges. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "driver/sim/range_source.hpp"
#include "slam/base/pose2.hpp"
#include "tools/sim/motion.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

struct WorldRangesOptions {
  std::uint64_t seed = 1;     // of the noise
  bool vertical = false;      // the scan's plane stands across the cart's way, step 540 looks up, step 0 to the right
  double height_m = 1.2;      // of the vertical scanner above the floor
  double ceiling_m = 2.8;     // above the floor; must be more than height_m
  std::int64_t start_ns = 0;  // true time at which the motion starts
  double halt_s = 0.0;        // of the motion: then the cart stands at once,
  double halt_for_s = 0.0;    // so long, and goes on as it was
};

// Pose of the cart at a true time.
[[nodiscard]] Pose2 pose_at(const Motion& motion, const WorldRangesOptions& options, double true_ns);

class WorldRanges final : public driver::RangeSource {
 public:
  WorldRanges(std::shared_ptr<const World> world, std::shared_ptr<const Motion> motion, WorldRangesOptions options);

  void measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
               std::span<std::uint32_t> intensity) override;

 private:
  [[nodiscard]] double horizontal_m(const Pose2& pose, double angle_rad) const;
  [[nodiscard]] double vertical_m(const Pose2& pose, double angle_rad) const;

  std::shared_ptr<const World> world_;
  std::shared_ptr<const Motion> motion_;
  WorldRangesOptions options_;
};

}  // namespace submapd::tools
