// A laser scanner on a cart that drives through a world: scans with exact truth, one at a time.
//
// Pull interface, so that a long run needs no memory for its scans. Each beam is cast from the exact pose at its own
// time. Noise comes from counter-based random numbers: same world, motion and options, same scans. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "slam/base/pose2.hpp"
#include "slam/scan/scan.hpp"
#include "tools/sim/beam.hpp"
#include "tools/sim/crowd.hpp"
#include "tools/sim/floor.hpp"
#include "tools/sim/motion.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

// 1081 beams over 270 deg, 40 revolutions a second of which 270 deg take 18.75 ms.
[[nodiscard]] inline ScanGeometry utm30lx_geometry() {
  ScanGeometry geometry;
  geometry.sweep_s = 0.01875;
  return geometry;
}

// Defaults: UTM-30LX.
struct SensorOptions {
  ScanGeometry geometry = utm30lx_geometry();
  int beams = 1081;
  std::int64_t period_us = 25'000;
  bool noise = true;             // false: exact ranges, rounded to 1 mm, none missing
  double sigma_near_m = 0.010;   // up to 10 m
  double sigma_far_m = 0.030;    // at 30 m, linear in between
  double bias_m = 0.0;           // added to every range
  double missing_near = 0.001;   // share of beams without a return
  double missing_far = 0.02;     // more of them at 30 m, with the square of the range
  double missing_grazing = 0.5;  // more of them where the beam meets the wall at 0 deg, none from 6 deg on
  double mixed_pixels = 0.0;     // share of the beams at an edge of 5 cm to 1.5 m that answer between both sides
  double range_bias_m = 0.0;     // largest error by range (a wave of 6 m, 40 %) and incidence (grazing is longer, 60 %)
  double clock_ppm = 0.0;        // the clock's rate is off by up to so much; if not 0, stamps are whole milliseconds
  double lost_scans = 0.0;       // share of single scans lost; a tenth as often begins a gap of up to 20
};

// Noise of a differential drive, random walks unless stated.
struct OdometryOptions {
  double distance_noise = 0.02;  // m per square root of a metre
  double turn_noise_rad = 0.02;  // rad per square root of a radian turned
  double drift_rad = 0.003;      // rad per square root of a metre
  double distance_scale = 0.01;  // sigma of a scale error that a seed keeps for the whole run
  double turn_scale = 0.02;      // the same for angles
};

struct SimulatorOptions {
  std::uint64_t seed = 1;
  std::int64_t start_stamp_us = 1'700'000'000'000'000;  // wall clock of the motion's time 0
  SensorOptions sensor;
  std::optional<OdometryOptions> odometry;   // nothing: scans carry no odometry
  std::shared_ptr<const Crowd> crowd;        // nothing: nobody walks about
  std::shared_ptr<const Floor> floor;        // nothing: it is level
  std::shared_ptr<const World> later_world;  // takes the world's place at half of the motion's time; nothing: none does
};

class Simulator {
 public:
  // REQUIRES: at least two beams, a positive period not shorter than the sweep.
  Simulator(std::shared_ptr<const World> world, std::shared_ptr<const Motion> motion, const SimulatorOptions& options);

  // The next scan that is not lost, nothing after the last one whose beams all lie within the motion.
  [[nodiscard]] std::optional<Scan> next();

  // Exact pose of the base at the scan's first beam, whatever its stamp says.
  [[nodiscard]] Pose2 truth(const Scan& scan) const { return motion_->at(start_s(scan.index)); }

  // Lost ones included.
  [[nodiscard]] std::uint64_t scan_count() const { return scan_count_; }

 private:
  [[nodiscard]] double start_s(std::uint64_t scan) const;
  [[nodiscard]] std::int64_t stamp_us(std::uint64_t scan) const;
  [[nodiscard]] bool lost(std::uint64_t scan);
  void look(std::uint64_t scan);
  [[nodiscard]] std::optional<Echo> look_along(const World& world, const Pose2& world_from_base, std::uint64_t scan,
                                               int beam) const;
  [[nodiscard]] std::uint16_t measure(std::uint64_t scan, int beam) const;
  [[nodiscard]] double systematic_m(const Echo& echo) const;
  [[nodiscard]] double step_beside_m(int beam) const;
  void advance_odometry(const Pose2& world_from_base, std::uint64_t scan);

  std::shared_ptr<const World> world_;
  std::shared_ptr<const Motion> motion_;
  SimulatorOptions options_;
  std::uint64_t scan_count_ = 0;
  std::uint64_t next_scan_ = 0;
  std::uint64_t gap_end_ = 0;                // scans before this one are lost
  std::vector<Disc> people_;                 // that the scan may see
  std::vector<std::optional<Echo>> echoes_;  // of the scan's beams, exact
  double clock_rate_ = 0.0;
  double bias_phase_rad_ = 0.0;
  Pose2 last_truth_;
  Pose2 odometry_;
  double distance_factor_ = 1.0;
  double turn_factor_ = 1.0;
};

}  // namespace submapd::tools
