#include "slam/graph/internal/coverage.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace submapd::graph {
namespace {

constexpr double kCellM = 0.5;
constexpr std::size_t kLeastKnownPart = 50;

std::uint64_t key_of(const Eigen::Vector2d& place) {
  const auto index = [](double metres) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::clamp(std::floor(metres / kCellM), -1e9, 1e9)));
  };
  return std::uint64_t{index(place.x())} << 32 | index(place.y());
}

}  // namespace

Coverage::Coverage(const GraphModel& model) : cells_of_(model.submaps.size()) {
  std::vector<std::uint64_t> keys;
  for (std::size_t k = 0; k < model.submaps.size(); ++k) {
    if (model.submaps[k].condensed()) continue;
    const SubmapOutline& outline = *model.submaps[k].outline;
    keys.clear();
    // Four places a cell: turned against the raster its cells would leave gaps.
    const double quarter = outline.coarse_cell_m / 4.0;
    for (const auto& cell : outline.known) {
      const Eigen::Vector2d middle((cell[0] + 0.5) * outline.coarse_cell_m, (cell[1] + 0.5) * outline.coarse_cell_m);
      for (const auto& [x, y] : {std::array{-1, -1}, std::array{1, -1}, std::array{-1, 1}, std::array{1, 1}}) {
        keys.push_back(key_of(transform(model.poses[k], middle + quarter * Eigen::Vector2d(x, y))));
      }
    }
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    cells_of_[k].reserve(keys.size());
    for (const std::uint64_t key : keys) {
      const auto [found, is_new] = cell_at_.try_emplace(key, static_cast<std::uint32_t>(known_to_.size()));
      if (is_new) known_to_.push_back(0);
      ++known_to_[found->second];
      cells_of_[k].push_back(found->second);
    }
  }
}

std::uint32_t Coverage::redundancy(std::uint32_t submap) const {
  std::vector<std::uint32_t> others;
  others.reserve(cells_of_[submap].size());
  for (const std::uint32_t cell : cells_of_[submap]) others.push_back(known_to_[cell] - 1);
  if (others.empty()) return std::numeric_limits<std::uint32_t>::max();  // it knows nothing
  const auto least = others.begin() + static_cast<std::ptrdiff_t>(others.size() / kLeastKnownPart);
  std::nth_element(others.begin(), least, others.end());
  return *least;
}

void Coverage::remove(std::uint32_t submap) {
  for (const std::uint32_t cell : cells_of_[submap]) --known_to_[cell];
  cells_of_[submap] = {};
}

}  // namespace submapd::graph
