// The finished map: every key-frame's scan laid down once more at its optimised pose (equation (8) on one dense grid).
//
// Sub-maps are rigid and the optimised graph bends between them, so the delivered map is built from the scans, not by
// pasting sub-maps. One byte of each count a cell; where the area does not fit the byte limit, cells become coarser.
#pragma once

#include <cstddef>
#include <vector>

#include "slam/grid/index_map.hpp"
#include "slam/matching/scan_points.hpp"
#include "slam/output/map_image.hpp"

namespace submapd {

class MapBuilder {
 public:
  MapBuilder(double cell_m, std::size_t bytes_limit, const OccupancyOptions& occupancy, int max_beams);

  // First pass: what the map must hold. Call for every key-frame, then begin().
  void extend(const Keyframe& keyframe, const Pose2& map_from_base);
  void begin();
  // Second pass.
  void insert(const Keyframe& keyframe, const Pose2& map_from_base);

  [[nodiscard]] MapImage image() const;
  [[nodiscard]] std::size_t bytes() const { return hits_.size() + misses_.size() + marks_.size(); }
  [[nodiscard]] std::size_t bytes_limit() const { return bytes_limit_; }

 private:
  void place(const Keyframe& keyframe, const Pose2& map_from_base);

  double cell_m_;
  std::size_t bytes_limit_;
  OccupancyOptions occupancy_;
  ScanPoints points_;
  std::vector<BeamEnd> placed_;  // beams about the cell corner next to the sensor, axes of the map
  Eigen::Vector2d corner_ = Eigen::Vector2d::Zero();
  Eigen::Vector2f origin_ = Eigen::Vector2f::Zero();
  Eigen::Vector2d low_;
  Eigen::Vector2d high_;
  FreeSpacePolygon free_space_;
  int width_ = 0;
  int height_ = 0;
  std::vector<std::uint8_t> hits_;
  std::vector<std::uint8_t> misses_;
  std::vector<std::uint8_t> marks_;
  std::uint8_t scan_mark_ = 0;
  std::size_t max_beams_;
};

}  // namespace submapd
