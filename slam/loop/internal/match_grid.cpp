#include "slam/loop/internal/match_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace submapd::internal {
namespace {

constexpr double kScoreSigma = 1.5;  // cells
constexpr int kKernelSide = 2 * kScoreReach + 1;

std::array<std::uint8_t, kKernelSide * kKernelSide> score_kernel() {
  std::array<std::uint8_t, kKernelSide * kKernelSide> kernel{};
  for (int y = -kScoreReach; y <= kScoreReach; ++y) {
    for (int x = -kScoreReach; x <= kScoreReach; ++x) {
      const double score = 255.0 * std::exp(-static_cast<double>(x * x + y * y) / (2.0 * kScoreSigma * kScoreSigma));
      kernel[static_cast<std::size_t>((y + kScoreReach) * kKernelSide + x + kScoreReach)] =
          static_cast<std::uint8_t>(score + 0.5);
    }
  }
  return kernel;
}

}  // namespace

// Stamping the kernel with max is the exact truncated distance transform: the score falls with the distance alone.
MatchGrid::Level MatchGrid::score_plane(const CellPlane& plane, const SurfaceIndex& surface) {
  static const auto kKernel = score_kernel();
  std::vector<std::uint8_t> occupied(static_cast<std::size_t>(plane.width()) *
                                     static_cast<std::size_t>(plane.height()));
  for (int y = 0; y < plane.height(); ++y) {
    const std::span<const CellKind> row = plane.row(y);
    std::uint8_t* out = &occupied[static_cast<std::size_t>(y) * row.size()];
    for (std::size_t x = 0; x < row.size(); ++x) out[x] = row[x] == CellKind::kOccupied ? 1 : 0;
  }
  for (const SurfaceElement& element : surface.elements()) {
    const Eigen::Vector2i cell = plane.cell_at(element.mean);
    if (cell.x() >= 0 && cell.y() >= 0 && cell.x() < plane.width() && cell.y() < plane.height()) {
      occupied[static_cast<std::size_t>(cell.y() * plane.width() + cell.x())] = 1;
    }
  }
  Level level;
  level.bias = kScoreReach;
  level.width = plane.width() + 2 * kScoreReach;
  level.height = plane.height() + 2 * kScoreReach;
  level.values.assign(static_cast<std::size_t>(level.width) * static_cast<std::size_t>(level.height), 0);
  for (int y = 0; y < plane.height(); ++y) {
    for (int x = 0; x < plane.width(); ++x) {
      if (occupied[static_cast<std::size_t>(y * plane.width() + x)] == 0) {
        continue;
      }
      for (int ky = 0; ky < kKernelSide; ++ky) {
        std::uint8_t* row = &level.values[static_cast<std::size_t>((y + ky) * level.width + x)];
        const std::uint8_t* stamp = &kKernel[static_cast<std::size_t>(ky * kKernelSide)];
        for (int kx = 0; kx < kKernelSide; ++kx) {
          row[kx] = std::max(row[kx], stamp[kx]);
        }
      }
    }
  }
  return level;
}

// Entry k of the coarser level bounds [k s, k s + 2^h + s) (s = stride > 1) or [k, k + 2^h) (s = 1), as the maximum
// over entries of the finer one whose ranges join to exactly that: two of them, three on the step from exact to
// strided.
MatchGrid::Level MatchGrid::coarser(const Level& fine, int level) {
  constexpr int kStrided = 3;  // first level that is
  Level coarse;
  coarse.shift = std::max(0, level - (kStrided - 1));
  const int halving = coarse.shift - fine.shift;  // 0 or 1
  std::array<int, 3> steps{};                     // in finer entries, from where the coarse one starts
  if (level < kStrided) {
    steps = {0, 1 << (level - 1), 1 << (level - 1)};
  } else if (level == kStrided) {
    steps = {0, 4, 6};
  } else {
    steps = {0, 5, 5};
  }
  // Finer columns are stored from -bias on; the coarse range must begin early enough to reach the first of them.
  coarse.bias = (fine.bias + steps[2] + (1 << halving) - 1) >> halving;
  const int fine_end_x = fine.width - fine.bias;
  const int fine_end_y = fine.height - fine.bias;
  coarse.width = coarse.bias + ((fine_end_x + halving) >> halving);
  coarse.height = coarse.bias + ((fine_end_y + halving) >> halving);

  // A row with room for every column that a coarse one asks for: without bounds to check the loop vectorises.
  const int before = (coarse.bias << halving) - fine.bias;
  const int last = ((coarse.width - 1) << halving) + steps[2];
  std::vector<std::uint8_t> padded(static_cast<std::size_t>(std::max(last + 1, before + fine.width)), 0);
  const int width = coarse.width;  // by itself: bytes may be written to any member, for all the compiler knows
  std::vector<std::uint8_t> rows(static_cast<std::size_t>(width) * static_cast<std::size_t>(fine.height));
  for (int y = 0; y < fine.height; ++y) {
    std::copy_n(&fine.values[static_cast<std::size_t>(y * fine.width)], fine.width, padded.data() + before);
    const std::uint8_t* in = padded.data();
    std::uint8_t* out = &rows[static_cast<std::size_t>(y * width)];
    if (halving == 0) {
      for (int k = 0; k < width; ++k) out[k] = std::max(std::max(in[k], in[k + steps[1]]), in[k + steps[2]]);
    } else {
      for (int k = 0; k < width; ++k) {
        out[k] = std::max(std::max(in[2 * k], in[2 * k + steps[1]]), in[2 * k + steps[2]]);
      }
    }
  }
  coarse.values.assign(static_cast<std::size_t>(coarse.width) * static_cast<std::size_t>(coarse.height), 0);
  for (int k = 0; k < coarse.height; ++k) {
    const int start = ((k - coarse.bias) << halving) + fine.bias;
    std::uint8_t* out = &coarse.values[static_cast<std::size_t>(k * width)];
    for (const int step : steps) {
      const int y = start + step;
      if (y < 0 || y >= fine.height) {
        continue;
      }
      const std::uint8_t* in = &rows[static_cast<std::size_t>(y * width)];
      for (int x = 0; x < width; ++x) {
        out[x] = std::max(out[x], in[x]);
      }
    }
  }
  return coarse;
}

MatchGrid::MatchGrid(const CellPlane& plane, const SurfaceIndex& surface, int levels) {
  levels_.push_back(score_plane(plane, surface));
  for (int level = 1; level < levels; ++level) {
    levels_.push_back(coarser(levels_.back(), level));
  }
}

std::uint8_t MatchGrid::value(int level, int x, int y) const {
  const Level& plane = levels_[static_cast<std::size_t>(level)];
  return plane.at((x >> plane.shift) + plane.bias, (y >> plane.shift) + plane.bias);
}

std::int32_t MatchGrid::sum(int level, const PointCells& points, int x, int y) const {
  const Level& plane = levels_[static_cast<std::size_t>(level)];
  const int shift = plane.shift;
  const int bias = plane.bias;
  const std::uint8_t* values = plane.values.data();
  const int width = plane.width;
  std::int32_t total = 0;
  for (const PointCell& point : points.inside) {
    const int column = ((point.x + x) >> shift) + bias;
    const int row = ((point.y + y) >> shift) + bias;
    total += values[row * width + column];
  }
  for (const PointCell& point : points.border) {
    total += plane.at(((point.x + x) >> shift) + bias, ((point.y + y) >> shift) + bias);
  }
  return total;
}

std::array<std::int32_t, 4> MatchGrid::sum4(int level, const PointCells& points, int x, int y, int step) const {
  const Level& plane = levels_[static_cast<std::size_t>(level)];
  const int shift = plane.shift;
  const int bias = plane.bias;
  const int apart = step >> shift;
  const std::uint8_t* values = plane.values.data();
  const int width = plane.width;
  std::array<std::int32_t, 4> total{};
  const auto add = [&](int column, int row) {
    const std::uint8_t* first = values + row * width + column;
    const std::uint8_t* second = first + apart * width;
    total[0] += first[0];
    total[1] += first[apart];
    total[2] += second[0];
    total[3] += second[apart];
  };
  for (const PointCell& point : points.inside) {
    add(((point.x + x) >> shift) + bias, ((point.y + y) >> shift) + bias);
  }
  const auto inner_width = static_cast<unsigned>(std::max(0, width - apart));
  const auto inner_height = static_cast<unsigned>(std::max(0, plane.height - apart));
  for (const PointCell& point : points.border) {
    const int column = ((point.x + x) >> shift) + bias;
    const int row = ((point.y + y) >> shift) + bias;
    if (static_cast<unsigned>(column) < inner_width && static_cast<unsigned>(row) < inner_height) {
      add(column, row);
    } else if (column + apart >= 0 && row + apart >= 0 && column < width && row < plane.height) {
      total[0] += plane.at(column, row);
      total[1] += plane.at(column + apart, row);
      total[2] += plane.at(column, row + apart);
      total[3] += plane.at(column + apart, row + apart);
    }
  }
  return total;
}

}  // namespace submapd::internal
