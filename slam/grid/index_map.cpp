#include "slam/grid/index_map.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr std::uint8_t kCountLimit = 240;  // either count: both are halved there (design notes 2, rule b)
constexpr double kMaxLogOdds = 20.0;
constexpr std::size_t kMaxRebuildsPerScan = 6;

double log_odds(double p) {
  return std::log(p / (1.0 - p));
}

}  // namespace

double occupancy_probability(std::uint64_t hits, std::uint64_t misses, const OccupancyOptions& options) {
  const double l = static_cast<double>(hits) * std::log(options.odds_hit) +
                   static_cast<double>(misses) * std::log(options.odds_free);
  return 1.0 / (1.0 + std::exp(-std::clamp(l, -kMaxLogOdds, kMaxLogOdds)));
}

IndexMap::IndexMap(const IndexMapOptions& options, DistanceLayers& layers)
    : options_(options),
      layers_(layers),
      layer_(layers.create()),
      cells_per_m_(1.0 / options.cell_m),
      surface_(options.max_faces, options.max_blocks),
      free_space_(options.free_space, options.cell_m, options.max_beams),
      blocks_(static_cast<std::size_t>(options.max_blocks) + 1),
      occupied_log_odds_(log_odds(options.occupancy.occupied_above)),
      free_log_odds_(log_odds(options.occupancy.free_below)) {
  hits_.reserve(static_cast<std::size_t>(options.max_beams));
  dirty_.reserve(kDirectorySize + kMaxRebuildsPerScan);
  for (std::size_t i = 0; i < 256; ++i) {
    hit_log_odds_[i] = static_cast<float>(static_cast<double>(i) * std::log(options.occupancy.odds_hit));
    miss_log_odds_[i] = static_cast<float>(static_cast<double>(i) * std::log(options.occupancy.odds_free));
  }
}

IndexMap::~IndexMap() {
  layers_.release(layer_);
}

void IndexMap::clear() {
  directory_.fill(0);
  used_blocks_ = 1;
  scan_mark_ = 0;
  dirty_.clear();
  is_dirty_.fill(false);
  surface_.clear();
  layers_.release(layer_);
  layer_ = layers_.create();  // cannot fail: one was just released
}

IndexMap::Block* IndexMap::ensure_block(int block) {
  std::uint16_t& handle = directory_[static_cast<std::size_t>(block)];
  if (handle == 0) {
    if (used_blocks_ == blocks_.size()) {
      ++refused_;
      return nullptr;
    }
    handle = static_cast<std::uint16_t>(used_blocks_++);
    Block& fresh = blocks_[handle];
    fresh.hits.fill(0);
    fresh.misses.fill(0);
    fresh.marks.fill(0);
    fresh.index = block;
  }
  return &blocks_[handle];
}

// Brings the obstacle mark of a cell (distance 0) in line with its counts, with hysteresis.
void IndexMap::review_cell(Block& block, int offset) {
  const auto o = static_cast<std::size_t>(offset);
  if (block.hits[o] >= kCountLimit || block.misses[o] >= kCountLimit) {
    block.hits[o] = static_cast<std::uint8_t>(block.hits[o] / 2);
    block.misses[o] = static_cast<std::uint8_t>(block.misses[o] / 2);
  }
  const double l = hit_log_odds_[block.hits[o]] + miss_log_odds_[block.misses[o]];
  const CellIndex cell{(block.index % kDirectoryBlocks) * kBlockCells + (offset & 63),
                       (block.index / kDirectoryBlocks) * kBlockCells + (offset >> 6)};
  const bool obstacle = layers_.view(layer_).at(cell) == 0;
  if (!obstacle && l > occupied_log_odds_) {
    if (!layers_.stamp(layer_, cell)) ++refused_;
  } else if (obstacle && l < free_log_odds_) {
    if (!layers_.clear_occupied(layer_, cell)) {
      ++refused_;
      return;  // still an obstacle: the next look through tries again
    }
    surface_.forget((cell.ix - kMapBias + 0.5) * options_.cell_m, (cell.iy - kMapBias + 0.5) * options_.cell_m);
    const int x0 = std::max(cell.ix - kDistanceRadiusCells, 0) >> 6;
    const int x1 = std::min(cell.ix + kDistanceRadiusCells, kMapCells - 1) >> 6;
    const int y0 = std::max(cell.iy - kDistanceRadiusCells, 0) >> 6;
    const int y1 = std::min(cell.iy + kDistanceRadiusCells, kMapCells - 1) >> 6;
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const int b = y * kDirectoryBlocks + x;
        if (!is_dirty_[static_cast<std::size_t>(b)]) {
          is_dirty_[static_cast<std::size_t>(b)] = true;
          dirty_.push_back(b);
        }
      }
    }
  }
}

bool IndexMap::add_hit(CellIndex cell) {
  Block* block = ensure_block(block_of(cell));
  if (block == nullptr) return false;
  const int offset = offset_of(cell);
  const auto o = static_cast<std::size_t>(offset);
  if (block->marks[o] != scan_mark_) {  // one count a cell and scan
    block->marks[o] = scan_mark_;
    ++block->hits[o];
    review_cell(*block, offset);
  }
  return block->misses[o] > block->hits[o];
}

void IndexMap::add_free_span(const RowSpan& span) {
  for (int ix = span.ix_begin; ix < span.ix_end;) {
    const int block_end = std::min((ix | 63) + 1, span.ix_end);
    Block* block = ensure_block(block_of({ix, span.iy}));
    if (block != nullptr) {
      const auto begin = static_cast<std::size_t>(offset_of({ix, span.iy}));
      const auto n = static_cast<std::size_t>(block_end - ix);
      const std::uint8_t* mark = block->marks.data() + begin;
      const std::uint8_t* hit = block->hits.data() + begin;
      std::uint8_t* miss = block->misses.data() + begin;
      const std::uint8_t now = scan_mark_;
      std::uint8_t any_hit = 0;
      for (std::size_t i = 0; i < n; ++i) {  // vectorises: free loses to a hit of the same scan
        const bool counts = mark[i] != now && miss[i] < kCountLimit;
        miss[i] = static_cast<std::uint8_t>(miss[i] + (counts ? 1 : 0));
        any_hit |= hit[i];
      }
      if (any_hit != 0) {
        for (std::size_t i = 0; i < n; ++i) {
          if (hit[i] != 0 && mark[i] != now) review_cell(*block, static_cast<int>(begin + i));
        }
      }
    }
    ix = block_end;
  }
}

bool IndexMap::insert(const Eigen::Vector2f& origin, std::span<const BeamEnd> beams) {
  const std::uint64_t refused_before = refused_ + surface_.refused();
  ++scan_mark_;
  if (scan_mark_ == 0) {
    for (std::size_t b = 1; b < used_blocks_; ++b) blocks_[b].marks.fill(0);
    scan_mark_ = 1;
  }
  hits_.clear();
  for (const BeamEnd& beam : beams) {
    if (!beam.hit || beam.range_m <= 0.0F) continue;
    const CellIndex cell = cell_at(beam.x, beam.y, cells_per_m_);
    if (!in_map(cell)) {
      ++refused_;
      continue;
    }
    const bool in_free = add_hit(cell);
    if (hits_.size() < hits_.capacity()) {
      const float s = 1.0F / beam.range_m;
      hits_.push_back({beam.x,
                       beam.y,
                       {(origin.x() - beam.x) * s, (origin.y() - beam.y) * s, beam.normal_x, beam.normal_y},
                       in_free});
    }
  }
  surface_.insert(hits_);
  for (const RowSpan& span : free_space_.convert(origin.x(), origin.y(), beams)) add_free_span(span);
  rebuild_dirty();
  return refused_ + surface_.refused() == refused_before;
}

void IndexMap::rebuild_dirty() {
  // A budget a scan keeps the worst case short; the rest stays marked and comes later.
  const std::size_t n = std::min(dirty_.size(), kMaxRebuildsPerScan);
  for (std::size_t i = 0; i < n; ++i) {
    if (layers_.rebuild_block(layer_, dirty_[i])) {
      is_dirty_[static_cast<std::size_t>(dirty_[i])] = false;
    } else {  // planes are full: again when it is this block's turn
      ++refused_;
      dirty_.push_back(dirty_[i]);
    }
  }
  dirty_.erase(dirty_.begin(), dirty_.begin() + static_cast<std::ptrdiff_t>(n));
}

IndexMap::Counts IndexMap::counts(CellIndex cell) const {
  if (!in_map(cell)) return {};
  const Block& block = blocks_[directory_[static_cast<std::size_t>(block_of(cell))]];
  const auto o = static_cast<std::size_t>(offset_of(cell));
  return {block.hits[o], block.misses[o]};
}

std::size_t IndexMap::bytes_used() const {
  return used_blocks_ * sizeof(Block) + surface_.bytes_used();
}
std::size_t IndexMap::bytes_limit() const {
  return blocks_.size() * sizeof(Block) + surface_.bytes_limit();
}

std::vector<OccupancyBlock> IndexMap::export_blocks() const {
  std::vector<OccupancyBlock> out;
  out.reserve(used_blocks_ - 1);
  for (int index = 0; index < kDirectorySize; ++index) {  // directory order is (by, bx)
    const std::uint16_t handle = directory_[static_cast<std::size_t>(index)];
    if (handle == 0) continue;
    const Block& block = blocks_[handle];
    OccupancyBlock copy;
    copy.bx = index % kDirectoryBlocks - kDirectoryBlocks / 2;
    copy.by = index / kDirectoryBlocks - kDirectoryBlocks / 2;
    for (std::size_t o = 0; o < kBlockArea; ++o) {
      if (block.hits[o] == 0 && block.misses[o] == 0) continue;
      const double l = std::clamp(static_cast<double>(hit_log_odds_[block.hits[o]] + miss_log_odds_[block.misses[o]]),
                                  -kMaxLogOdds, kMaxLogOdds);
      copy.cells[o] = cell_of(1.0 / (1.0 + std::exp(-l)));
    }
    out.push_back(copy);
  }
  return out;
}

std::vector<SurfacePoint> IndexMap::export_surface() const {
  std::vector<SurfacePoint> out;
  const std::span<const SurfaceFace> faces = surface_.faces();
  for (std::size_t i = 1; i < faces.size(); ++i) {
    const SurfaceFace& face = faces[i];
    if (face.n < 1.0F || face.line().kind == SurfaceKind::kNone) continue;
    SurfacePoint point;
    point.x = surface_centre(static_cast<int>(face.cell % kSurfaceSide)) + face.sum_x / face.n;
    point.y = surface_centre(static_cast<int>(face.cell / kSurfaceSide)) + face.sum_y / face.n;
    const PooledLine& line = face.line();
    point.normal_x = line.normal_x;
    point.normal_y = line.normal_y;
    point.sigma_m = line.sigma_m;
    point.hits = static_cast<std::uint16_t>(std::min(face.n, 65535.0F));
    point.keyframes = face.keyframes;
    point.view_sectors = face.view_sectors;
    out.push_back(point);
  }
  return out;
}

}  // namespace submapd
