// cloud.ply: the vertical scanner's beams, each posed on the optimised trajectory at its own instant (design
// notes 14.1).
//
// Streamed in bounded memory: the scans are read twice, first to count, so that the size is known before a byte is
// written. One thread; blocks on the disk.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

#include "slam/output/optimized_trajectory.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

// Where the vertical scanner sits: its pose in base, turned about the fixed x, y and z axis in this order (as ROS
// does). By default it stands upright: front to the sky, its left to the left, scanning across the way.
struct ScannerMount {
  double x_m = 0.0;
  double y_m = 0.0;
  double z_m = 0.0;  // above the floor: then heights in the cloud are, too
  double roll_rad = 0.0;
  double pitch_rad = -std::numbers::pi / 2;
  double yaw_rad = 0.0;

  // Columns: the scanner's axes in base.
  [[nodiscard]] Eigen::Matrix3d rotation() const;
  [[nodiscard]] Eigen::Vector3d translation() const { return {x_m, y_m, z_m}; }
};

// A sweep in order of time; geometry.base_from_sensor is not used.
struct CloudScan {
  Scan scan;
  std::vector<std::uint16_t> intensities;  // one a beam, or none
};

// Scans from the first on, whenever it is opened.
class CloudScans {
 public:
  CloudScans() = default;
  CloudScans(const CloudScans&) = delete;
  CloudScans& operator=(const CloudScans&) = delete;
  virtual ~CloudScans() = default;
  // The next scan, or nothing at the end.
  [[nodiscard]] virtual Expected<std::optional<CloudScan>> next() = 0;
};
using OpenCloudScans = std::function<Expected<std::unique_ptr<CloudScans>>()>;

struct CloudSize {
  std::uint64_t points = 0;
  std::uint64_t scans = 0;                    // that gave points
  bool intensities = false;                   // some scan has them
  [[nodiscard]] std::uint64_t bytes() const;  // of the file, its header included
};

// Beams without a return, beams before the first and after the last pose, and beams in gaps of the trajectory of more
// than half a second, or where tracking broke, give no point.
[[nodiscard]] Expected<CloudSize> measure_cloud(const OptimizedTrajectory& trajectory, const ScannerMount& mount,
                                                const OpenCloudScans& open);

// The first `size.points` points: later scans may have come meanwhile. `progress` hears of shares from 0 to 1. Errors:
// kIo, those of the scans, kInternal (fewer points than measured).
Status write_cloud(const std::filesystem::path& path, const CloudSize& size, const OptimizedTrajectory& trajectory,
                   const ScannerMount& mount, const OpenCloudScans& open, const std::function<void(double)>& progress);

}  // namespace submapd
