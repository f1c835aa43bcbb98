#include "slam/output/map_files.hpp"

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {
namespace {

Status write_pgm(const std::filesystem::path& path, const MapImage& map) {
  std::array<std::uint8_t, 256> pixel_of{};
  for (std::size_t cell = 0; cell < pixel_of.size(); ++cell)
    pixel_of[cell] = map_pixel(static_cast<std::uint8_t>(cell));

  AtomicFile file(path);
  if (Status status = file.write(fmt::format("P5\n{} {}\n255\n", map.width, map.height)); !status.ok()) return status;
  std::vector<std::uint8_t> row(static_cast<std::size_t>(map.width));
  for (int y = map.height - 1; y >= 0; --y) {
    for (int x = 0; x < map.width; ++x) row[static_cast<std::size_t>(x)] = pixel_of[map.at(x, y)];
    if (Status status = file.write(std::as_bytes(std::span(row))); !status.ok()) return status;
  }
  return file.commit();
}

// A plain decimal with a point: YAML 1.1 readers take "1e-05" for a string and "1" for an integer.
std::string yaml_number(double value) {
  std::string text = fmt::format("{:.9f}", value + 0.0);  // no "-0.0"
  while (text.back() == '0' && text[text.size() - 2] != '.') text.pop_back();
  return text;
}

Status write_yaml(const std::filesystem::path& path, const MapImage& map) {
  const std::string text = fmt::format(
      "image: map.pgm\n"
      "mode: trinary\n"
      "resolution: {}\n"
      "origin: [{}, {}, 0.0]\n"
      "negate: 0\n"
      "occupied_thresh: {}\n"
      "free_thresh: {}\n",
      yaml_number(map.cell_m), yaml_number(map.origin_x_m), yaml_number(map.origin_y_m), kOccupiedThreshold,
      kFreeThreshold);
  return atomic_write_file(path, std::as_bytes(std::span(text)));
}

}  // namespace

std::uint8_t map_pixel(std::uint8_t cell) {
  if (cell == 0) return kUnknownPixel;
  const double occupancy = occupancy_of(cell);
  if (occupancy > kOccupiedThreshold) return kOccupiedPixel;
  return occupancy < kFreeThreshold ? kFreePixel : kUnknownPixel;
}

Status write_map_files(const std::filesystem::path& folder, const MapImage& map) {
  if (Status status = check_map_image(map); !status.ok()) {
    return Status(status.code(), (folder / "map.pgm").string() + ": " + status.message());
  }
  if (Status status = write_pgm(folder / "map.pgm", map); !status.ok()) return status;
  return write_yaml(folder / "map.yaml", map);
}

}  // namespace submapd
