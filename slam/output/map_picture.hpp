// map.png: the map for people, with path, sub-maps, loops, scale bar and legend.
//
// The long side has 1200 to 2400 pixels where the map allows: small maps are enlarged up to eight times, big ones
// shrunk. Text chunks of the file give "Title", "Software", "Resolution" (m per pixel) and "Origin" (map frame
// position, m, of the picture's lower-left corner), so that pixels can be turned into metres.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "slam/output/map_image.hpp"

namespace submapd {

struct SubmapMark {
  std::uint32_t index = 0;
  Pose2 map_from_submap;
};

// A loop closure between the origins of two sub-maps, in the map frame.
struct LoopMark {
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  bool confirmed = false;  // false: pending, drawn dashed
};

// What the picture shows; `map` and `path` must outlive the call.
struct PictureInput {
  const MapImage& map;
  std::span<const Pose2> path;  // in order of time, map frame; any number
  std::vector<SubmapMark> submaps;
  std::vector<LoopMark> loops;
  std::string title;     // ASCII; other bytes show as '?'
  std::string subtitle;  // small, below: software version, date, seed
};

// "name - 312 m, 14 sub-maps, 3 loops".
[[nodiscard]] std::string picture_title(std::string_view name, double length_m, std::size_t submaps, std::size_t loops);

// Draws and writes the picture; it appears whole or not at all. Takes up to 18 MB while it draws, whatever the size of
// the map. Blocks on the disk.
[[nodiscard]] Status write_map_picture(const std::filesystem::path& path, const PictureInput& input);

}  // namespace submapd
