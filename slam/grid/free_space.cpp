#include "slam/grid/free_space.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {

Eigen::Vector2f place_beams(const Pose2& pose, std::span<const BeamEnd> beams, const Eigen::Vector2f& origin,
                            std::vector<BeamEnd>& placed) {
  const auto c = static_cast<float>(std::cos(pose.yaw));
  const auto s = static_cast<float>(std::sin(pose.yaw));
  const auto x = static_cast<float>(pose.x);
  const auto y = static_cast<float>(pose.y);
  placed.clear();
  for (const BeamEnd& b : beams.first(std::min(beams.size(), placed.capacity()))) {
    placed.push_back({x + c * b.x - s * b.y, y + s * b.x + c * b.y, b.range_m, b.hit, c * b.normal_x - s * b.normal_y,
                      s * b.normal_x + c * b.normal_y});
  }
  return {x + c * origin.x() - s * origin.y(), y + s * origin.x() + c * origin.y()};
}

FreeSpacePolygon::FreeSpacePolygon(const FreeSpaceOptions& options, double cell_m, int max_beams)
    : options_(options),
      cells_per_m_(static_cast<float>(1.0 / cell_m)),
      max_beams_(static_cast<std::size_t>(max_beams)) {
  const auto rows = static_cast<std::size_t>(2.0 * options.max_range_m / cell_m) + 8;
  vertices_.reserve(2 * max_beams_ + 2);
  row_start_.reserve(rows + 1);
  // An edge crosses at most `rows` rows, but all edges together hardly more than a few per row and beam.
  crossings_.reserve(rows * 64 + 4 * max_beams_);
  spans_.reserve(rows * 32);
}

void FreeSpacePolygon::add_vertex(float u, float v) {
  vertices_.push_back({u, v});
}

std::span<const RowSpan> FreeSpacePolygon::convert(float origin_x, float origin_y, std::span<const BeamEnd> beams) {
  vertices_.clear();
  spans_.clear();
  if (beams.size() > max_beams_) beams = beams.first(max_beams_);
  if (beams.size() < 2) return {};
  const auto max_range = static_cast<float>(options_.max_range_m);
  const float pull_back_m = static_cast<float>(options_.pull_back_cells) / cells_per_m_;
  const auto jump = static_cast<float>(options_.edge_jump_m);
  const float bias = static_cast<float>(kMapBias);
  const float ou = origin_x * cells_per_m_ + bias;
  const float ov = origin_y * cells_per_m_ + bias;

  const auto reach = [&](const BeamEnd& b) {
    const float end = b.hit ? b.range_m - pull_back_m : b.range_m;
    return std::clamp(end, 0.0F, max_range);
  };
  const auto place = [&](const BeamEnd& b, float range) {
    const float s = range / b.range_m;
    add_vertex(ou + s * (b.x - origin_x) * cells_per_m_, ov + s * (b.y - origin_y) * cells_per_m_);
  };
  // Each pair of neighbours spans one triangle with the origin; runs of pairs without evidence fall back to the origin.
  add_vertex(ou, ov);
  for (std::size_t i = 0; i + 1 < beams.size(); ++i) {
    float a = reach(beams[i]);
    float b = reach(beams[i + 1]);
    if (a <= 0.0F || b <= 0.0F) {
      if (vertices_.back().u != ou || vertices_.back().v != ov) add_vertex(ou, ov);
      continue;
    }
    if (std::abs(a - b) > jump) a = b = std::min(a, b);
    place(beams[i], a);
    place(beams[i + 1], b);
  }
  collect_crossings();
  for (int row = first_row_; row <= last_row_; ++row) {
    const auto r = static_cast<std::size_t>(row - first_row_);
    float* begin = crossings_.data() + row_start_[r];
    float* end = crossings_.data() + row_start_[r + 1];
    std::sort(begin, end);
    // Cells whose centre (index + 0.5) lies inside [begin, end) of each even-odd pair. Vertices shared by neighbouring
    // triangles make crossings that coincide; their empty spans drop out here.
    int previous_end = 0;
    for (float* c = begin; c + 1 < end; c += 2) {
      const int ix_begin = std::max({static_cast<int>(std::ceil(c[0] - 0.5F)), previous_end, 0});
      const int ix_end = std::min(static_cast<int>(std::ceil(c[1] - 0.5F)), kMapCells);
      if (ix_end <= ix_begin) continue;
      if (spans_.size() == spans_.capacity()) return spans_;
      spans_.push_back({row, ix_begin, ix_end});
      previous_end = ix_end;
    }
  }
  return spans_;
}

void FreeSpacePolygon::collect_crossings() {
  float v_min = vertices_[0].v;
  float v_max = v_min;
  for (const Vertex& p : vertices_) {
    v_min = std::min(v_min, p.v);
    v_max = std::max(v_max, p.v);
  }
  first_row_ = std::max(static_cast<int>(std::ceil(v_min - 0.5F)), 0);
  last_row_ = std::min(static_cast<int>(std::ceil(v_max - 0.5F)) - 1, kMapCells - 1);
  const int rows = std::max(last_row_ - first_row_ + 1, 0);
  row_start_.assign(static_cast<std::size_t>(rows) + 1, 0);
  if (rows == 0) return;

  // Rows whose centre line (row + 0.5) the edge from a to b crosses, half open so that a vertex counts once.
  const auto rows_of = [&](const Vertex& a, const Vertex& b) {
    const float low = std::min(a.v, b.v);
    const float high = std::max(a.v, b.v);
    const int begin = std::max(static_cast<int>(std::ceil(low - 0.5F)), first_row_);
    const int end = std::min(static_cast<int>(std::ceil(high - 0.5F)), last_row_ + 1);
    return std::pair<int, int>(begin, end);
  };
  const std::size_t n = vertices_.size();
  for (std::size_t i = 0; i < n; ++i) {
    const auto [begin, end] = rows_of(vertices_[i], vertices_[(i + 1) % n]);
    for (int row = begin; row < end; ++row) ++row_start_[static_cast<std::size_t>(row - first_row_)];
  }
  std::uint32_t total = 0;
  for (std::uint32_t& start : row_start_) {
    const std::uint32_t count = start;
    start = total;
    total += count;
  }
  crossings_.resize(total);  // within the reserved capacity for any real scan
  for (std::size_t i = 0; i < n; ++i) {
    const Vertex& a = vertices_[i];
    const Vertex& b = vertices_[(i + 1) % n];
    const auto [begin, end] = rows_of(a, b);
    if (begin >= end) continue;
    const float slope = (b.u - a.u) / (b.v - a.v);
    for (int row = begin; row < end; ++row) {
      const float u = a.u + (static_cast<float>(row) + 0.5F - a.v) * slope;
      crossings_[row_start_[static_cast<std::size_t>(row - first_row_)]++] = u;
    }
  }
  // The fill moved each start to the next row's; move them back.
  for (std::size_t r = row_start_.size() - 1; r > 0; --r) row_start_[r] = row_start_[r - 1];
  row_start_[0] = 0;
}

}  // namespace submapd
