// map.pgm and map.yaml: the pair that ROS map_server and nav2 load.
//
// Trinary. Readers take p = (255 - pixel) / 255 for the occupancy; our three pixels lie on the right side of both
// thresholds under the strict rule (nav2) and the >= rule (ROS 1). Unknown, 205, is p = 0.19608: free_thresh must be
// 0.196, with nav2's own default of 0.25 it would load as free.
#pragma once

#include <cstdint>
#include <filesystem>

#include "slam/base/status.hpp"
#include "slam/output/map_image.hpp"

namespace submapd {

inline constexpr double kOccupiedThreshold = 0.65;  // above: occupied
inline constexpr double kFreeThreshold = 0.196;     // below: free
inline constexpr std::uint8_t kOccupiedPixel = 0;
inline constexpr std::uint8_t kUnknownPixel = 205;
inline constexpr std::uint8_t kFreePixel = 254;

// The pixel of a cell's byte.
[[nodiscard]] std::uint8_t map_pixel(std::uint8_t cell);

// Writes map.pgm (P5, row 0 the largest y), then map.yaml, into `folder`, which must exist. Each appears whole or not
// at all; the yaml comes last, so it never names a missing image. Needs one row of memory beside the map. Blocks on the
// disk.
[[nodiscard]] Status write_map_files(const std::filesystem::path& folder, const MapImage& map);

}  // namespace submapd
