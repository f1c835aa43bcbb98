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
#include "tools/sim/crowd.hpp"
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
  std::optional<OdometryOptions> odometry;  // nothing: scans carry no odometry
  std::shared_ptr<const Crowd> crowd;       // nothing: nobody walks about
};

class Simulator {
 public:
  // REQUIRES: at least two beams, a positive period not shorter than the sweep.
  Simulator(std::shared_ptr<const World> world, std::shared_ptr<const Motion> motion, const SimulatorOptions& options);

  // The next scan, nothing after the last one whose beams all lie within the motion.
  [[nodiscard]] std::optional<Scan> next();

  // Exact pose of the base, e.g. truth(scan.stamp_us).
  [[nodiscard]] Pose2 truth(std::int64_t stamp_us) const;

  [[nodiscard]] std::uint64_t scan_count() const { return scan_count_; }

 private:
  [[nodiscard]] std::uint16_t measure(const Pose2& world_from_sensor, double since_scan_s, std::uint64_t scan,
                                      std::uint64_t beam) const;
  void advance_odometry(const Pose2& world_from_base, std::uint64_t scan);

  std::shared_ptr<const World> world_;
  std::shared_ptr<const Motion> motion_;
  SimulatorOptions options_;
  std::uint64_t scan_count_ = 0;
  std::uint64_t next_scan_ = 0;
  std::vector<Disc> people_;  // that the scan may see
  Pose2 last_truth_;
  Pose2 odometry_;
  double distance_factor_ = 1.0;
  double turn_factor_ = 1.0;
};

}  // namespace submapd::tools
