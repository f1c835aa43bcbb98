#include "slam/loop/submap_outline.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "slam/base/floor_to_int.hpp"

namespace submapd {
namespace {

constexpr double kRadiusShare = 0.95;
constexpr int kMaxCoarse = 30000;  // fits the 16 bits it is stored in

int coarse_of(double coordinate_m, double coarse_cell_m) {
  return static_cast<int>(std::floor(coordinate_m / coarse_cell_m));
}

// Adds the known fine cells of a block to the coarse cells they lie in.
void add_block(const OccupancyBlock& block, double cell_m, double coarse_cell_m,
               std::map<std::pair<int, int>, int>& counts) {
  std::array<int, kBlockCells> coarse_x{};
  for (int cx = 0; cx < kBlockCells; ++cx) {
    coarse_x[static_cast<std::size_t>(cx)] =
        coarse_of((static_cast<double>(block.bx) * kBlockCells + cx + 0.5) * cell_m, coarse_cell_m);
  }
  for (int cy = 0; cy < kBlockCells; ++cy) {
    const int y = coarse_of((static_cast<double>(block.by) * kBlockCells + cy + 0.5) * cell_m, coarse_cell_m);
    int run = 0;  // known cells since the coarse column changed
    for (std::size_t cx = 0; cx < kBlockCells; ++cx) {
      run += block.cells[static_cast<std::size_t>(cy) * kBlockCells + cx] != 0 ? 1 : 0;
      const bool last = cx + 1 == kBlockCells || coarse_x[cx + 1] != coarse_x[cx];
      if (last && run > 0) {
        counts[{y, coarse_x[cx]}] += run;
        run = 0;
      }
    }
  }
}

void find_extent(SubmapOutline& outline) {
  if (outline.known.empty()) {
    return;
  }
  std::vector<Eigen::Vector2d> centres;
  centres.reserve(outline.known.size());
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const auto& cell : outline.known) {
    centres.push_back(outline.coarse_cell_m * Eigen::Vector2d(cell[0] + 0.5, cell[1] + 0.5));
    sum += centres.back();
  }
  outline.centre = sum / static_cast<double>(centres.size());
  std::vector<double> distances;
  distances.reserve(centres.size());
  for (const Eigen::Vector2d& centre : centres) {
    distances.push_back((centre - outline.centre).norm());
  }
  const auto rank = static_cast<std::ptrdiff_t>(kRadiusShare * static_cast<double>(distances.size() - 1));
  std::nth_element(distances.begin(), distances.begin() + rank, distances.end());
  outline.radius_m = distances[static_cast<std::size_t>(rank)] + 0.5 * outline.coarse_cell_m;
}

// The known cells of an outline and all within grow_m of them, as runs of columns by row.
class GrownCells {
 public:
  // REQUIRES: outline.known is not empty.
  GrownCells(const SubmapOutline& outline, double grow_m) {
    const double reach = grow_m / outline.coarse_cell_m + 1e-9;
    const int steps = static_cast<int>(std::min(reach, static_cast<double>(kMaxCoarse)));
    first_row_ = outline.known.front()[1] - steps;
    runs_.resize(static_cast<std::size_t>(outline.known.back()[1] + steps - first_row_ + 1));
    std::vector<int> half_width;  // of what a cell grows into, by rows from it
    for (int dy = 0; dy <= steps; ++dy) {
      half_width.push_back(static_cast<int>(std::sqrt(std::max(0.0, reach * reach - dy * dy))));
    }
    for (std::size_t i = 0; i < outline.known.size();) {
      const auto& [first, y] = outline.known[i];
      int last = first;
      while (++i < outline.known.size() && outline.known[i][1] == y && outline.known[i][0] == last + 1) ++last;
      for (int dy = -steps; dy <= steps; ++dy) {
        const int half = half_width[static_cast<std::size_t>(std::abs(dy))];
        add(runs_[static_cast<std::size_t>(y + dy - first_row_)], first - half, last + half);
      }
    }
    Runs scratch;
    for (auto& row : runs_) {
      merge(row, scratch);
    }
  }

  [[nodiscard]] bool contains(int x, int y) const {
    const int row = y - first_row_;
    if (row < 0 || row >= static_cast<int>(runs_.size())) {
      return false;
    }
    for (const auto& [first, last] : runs_[static_cast<std::size_t>(row)]) {
      if (x <= last) return x >= first;
    }
    return false;
  }

 private:
  using Runs = std::vector<std::pair<int, int>>;  // first and last column

  static void add(Runs& row, int first, int last) {
    if (!row.empty() && first >= row.back().first && first <= row.back().second + 1) {
      row.back().second = std::max(row.back().second, last);
    } else {
      row.emplace_back(first, last);
    }
  }
  static void merge(Runs& row, Runs& scratch) {
    std::sort(row.begin(), row.end());
    scratch.clear();
    for (const auto& [first, last] : row) add(scratch, first, last);
    row.swap(scratch);
  }

  int first_row_ = 0;
  std::vector<Runs> runs_;
};

}  // namespace

SubmapOutline make_outline(const FinishedSubmap& submap) {
  SubmapOutline outline;
  outline.index = submap.id.index;

  std::map<std::pair<int, int>, int> counts;  // (y, x) of a coarse cell: known fine cells
  for (const OccupancyBlock& block : submap.blocks) {
    add_block(block, submap.cell_m, outline.coarse_cell_m, counts);
  }
  const double per_coarse = outline.coarse_cell_m * outline.coarse_cell_m / (submap.cell_m * submap.cell_m);
  for (const auto& [cell, count] : counts) {
    const bool storable = std::abs(cell.first) <= kMaxCoarse && std::abs(cell.second) <= kMaxCoarse;
    if (storable && 2.0 * count >= per_coarse) {
      outline.known.push_back({static_cast<std::int16_t>(cell.second), static_cast<std::int16_t>(cell.first)});
    }
  }
  find_extent(outline);

  double total = 0.0;
  for (const SurfacePoint& point : submap.surface) {
    if (point.normal_x == 0.0F && point.normal_y == 0.0F) {
      continue;
    }
    const double turn = std::atan2(point.normal_y, point.normal_x) / (2.0 * std::numbers::pi);
    const int bin = (static_cast<int>(std::floor(turn * 360.0)) + 360) % 360;
    outline.normal_histogram[static_cast<std::size_t>(bin)] += 1.0F;  // each stands for one surface cell of length
    total += 1.0;
  }
  for (float& bin : outline.normal_histogram) {
    bin = total > 0.0 ? static_cast<float>(bin / total) : 0.0F;
  }
  return outline;
}

double overlap_m2(const SubmapOutline& a, const SubmapOutline& b, const Pose2& a_from_b, double grow_m) {
  if (a.known.empty()) {
    return 0.0;
  }
  const GrownCells grown(a, std::max(0.0, grow_m));
  // In cells of a.
  const double scale = b.coarse_cell_m / a.coarse_cell_m;
  const Eigen::Matrix2d turn = scale * rotation(a_from_b.yaw);
  const Eigen::Vector2d shift = a_from_b.translation() / a.coarse_cell_m;
  std::size_t common = 0;
  for (const auto& cell : b.known) {
    const Eigen::Vector2d place = turn * Eigen::Vector2d(cell[0] + 0.5, cell[1] + 0.5) + shift;
    common += grown.contains(floor_to_int(place.x()), floor_to_int(place.y())) ? 1 : 0;
  }
  return static_cast<double>(common) * b.coarse_cell_m * b.coarse_cell_m;
}

}  // namespace submapd
