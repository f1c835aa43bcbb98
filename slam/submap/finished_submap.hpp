// A sub-map once it is closed: immutable, self-contained, what travels over LCM and lies in the archive.
//
// Frame: the sub-map's own, whose origin is the pose of its first key-frame. Value type without methods that change it;
// share it as std::shared_ptr<const FinishedSubmap>.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/pose2.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

// Why a sub-map was closed (design notes, section 7).
enum class FinishReason : std::uint8_t {
  kPath = 0,
  kExtent = 1,
  kKeyframes = 2,
  kBlocks = 3,
  kHeading = 4,
  kDegenerate = 5,  // entering or leaving a span where a direction is not observable
  kDivergence = 6,
  kEndOfRun = 7,
  kCommand = 8,  // the operator asked for a new run
};

// A track point x_i: a scan that was inserted into the map, with what is needed to use it again.
struct Keyframe {
  std::uint64_t scan_index = 0;
  std::int64_t stamp_us = 0;
  Pose2 pose;                                                 // of base at the stamp, in the sub-map's frame
  Twist2 twist;                                               // body twist during the sweep, for unwarping
  Eigen::Matrix3d step_covariance = Eigen::Matrix3d::Zero();  // of the motion since the previous key-frame, in that
                                                              // key-frame's frame (x, y, yaw; m^2, m rad, rad^2)
  bool degenerate = false;  // a direction was not observable since the previous key-frame
  ScanGeometry geometry;
  std::vector<std::uint16_t> ranges_mm;
};

inline constexpr int kBlockCells = 64;  // cells along one side of a block

// One block of 64 x 64 cells of the index map. Cell (cx, cy) of the block covers
// [(64 * bx + cx) * cell, +cell) x [(64 * by + cy) * cell, +cell) in the sub-map's frame; row-major, index = cy * 64 +
// cx.
struct OccupancyBlock {
  std::int32_t bx = 0;
  std::int32_t by = 0;
  std::array<std::uint8_t, kBlockCells * kBlockCells> cells{};  // 0 unknown, else occupancy_of()
};

// Probability that a cell is occupied, equation (8), from its stored byte 1..255.
[[nodiscard]] inline double occupancy_of(std::uint8_t cell) {
  return (static_cast<double>(cell) - 1.0) / 254.0;
}
// Stored byte of a probability in [0, 1].
[[nodiscard]] inline std::uint8_t cell_of(double occupancy) {
  return static_cast<std::uint8_t>(1.0 + 254.0 * occupancy + 0.5);
}

// A piece of surface: the mean of the hits in one 10 cm cell and, where they form a line, its normal.
struct SurfacePoint {
  float x = 0.0F;         // m
  float y = 0.0F;         // m
  float normal_x = 0.0F;  // unit normal towards the side the scanner saw it from; (0, 0): not line-like
  float normal_y = 0.0F;
  float sigma_m = 0.0F;           // spread across the line, or of the hits if not line-like
  std::uint16_t hits = 0;         // saturates
  std::uint16_t keyframes = 0;    // distinct key-frames that hit it; saturates
  std::uint8_t view_sectors = 0;  // bit k: seen from direction sector k * 45 deg .. (k + 1) * 45 deg
};

struct FinishedSubmap {
  SubmapId id;
  Pose2 odom_from_submap;  // the sub-map's frame in the run's continuous "odom" frame
  FinishReason reason = FinishReason::kEndOfRun;
  double cell_m = 0.05;
  // The next sub-map shares this one's key-frames from its own first one on (same scan_index); false after a break:
  // nothing ties this sub-map to the previous one and only loops can.
  bool linked_to_previous = true;
  std::vector<Keyframe> keyframes;     // in order of time, at least one; keyframes[0].pose is the identity
  std::vector<OccupancyBlock> blocks;  // sorted by (by, bx), no two alike
  std::vector<SurfacePoint> surface;   // in a fixed order
};

}  // namespace submapd
