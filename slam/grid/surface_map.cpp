#include "slam/grid/surface_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "slam/base/floor_to_int.hpp"

namespace submapd {
namespace {

constexpr float kMaxHits = 2000.0F;         // halve beyond: finite inertia against moved walls
constexpr float kSameSide = -0.17F;         // cosine: views up to 100 deg apart belong to one face
constexpr float kLineRatio = 0.1F;          // smaller to larger eigenvalue of a line's scatter
constexpr float kMinLineSpread_m2 = 4e-4F;  // (2 cm)^2 along a line at least
constexpr float kMinHitsForLine = 3.0F;

float view_agreement(const SurfaceFace& face, float view_x, float view_y) {
  const float norm = std::sqrt(face.view_x * face.view_x + face.view_y * face.view_y);
  return norm > 0.0F ? (face.view_x * view_x + face.view_y * view_y) / norm : 1.0F;
}

int surface_index(float position_m) {
  return floor_to_int(position_m * static_cast<float>(1.0 / kSurfaceCell_m)) + kSurfaceBias;
}

// Which eighth of the circle a direction lies in, counted from +x.
unsigned octant(float x, float y) {
  if (y >= 0.0F) return x > 0.0F ? (y < x ? 0U : 1U) : (y > -x ? 2U : 3U);
  return x < 0.0F ? (-y < -x ? 4U : 5U) : (-y > x ? 6U : 7U);
}

bool in_surface(int ix, int iy) {
  return ix >= 1 && iy >= 1 && ix < kSurfaceSide - 1 && iy < kSurfaceSide - 1;
}

std::size_t block_index(int ix, int iy) {
  return static_cast<std::size_t>((iy >> 5) * kDirectoryBlocks + (ix >> 5));
}
std::size_t slot_index(int ix, int iy) {
  return static_cast<std::size_t>(((iy & 31) << 5) | (ix & 31));
}

}  // namespace

SurfaceMap::SurfaceMap(int max_faces, int max_blocks)
    : faces_(static_cast<std::size_t>(std::min(max_faces, 65535))), blocks_(static_cast<std::size_t>(max_blocks) + 1) {
  touched_.reserve(4096);
}

void SurfaceMap::clear() {
  used_faces_ = 1;
  directory_.fill(0);
  used_blocks_ = 1;
  scan_ = 0;
}

std::uint16_t SurfaceMap::find_face(int ix, int iy, float view_x, float view_y) const {
  std::uint16_t f = blocks_[directory_[block_index(ix, iy)]].slot[slot_index(ix, iy)];
  while (f != 0) {
    if (view_agreement(faces_[f], view_x, view_y) > kSameSide) return f;
    f = faces_[f].other;
  }
  return 0;
}

std::uint16_t SurfaceMap::ensure_face(int ix, int iy, float view_x, float view_y) {
  std::uint16_t& handle = directory_[block_index(ix, iy)];
  if (handle == 0) {
    if (used_blocks_ == blocks_.size()) {
      ++refused_;
      return 0;
    }
    handle = static_cast<std::uint16_t>(used_blocks_++);
    blocks_[handle].slot.fill(0);
  }
  std::uint16_t* link = &blocks_[handle].slot[slot_index(ix, iy)];
  while (*link != 0) {
    if (view_agreement(faces_[*link], view_x, view_y) > kSameSide) return *link;
    link = &faces_[*link].other;
  }
  if (used_faces_ == faces_.size()) {
    ++refused_;
    return 0;
  }
  *link = static_cast<std::uint16_t>(used_faces_++);
  SurfaceFace& face = faces_[*link];
  face = SurfaceFace{};
  face.cell = static_cast<std::uint32_t>(iy * kSurfaceSide + ix);
  face.view_x = view_x * 1e-3F;  // a hint until the cell has hits of its own
  face.view_y = view_y * 1e-3F;
  return *link;
}

void SurfaceMap::insert(std::span<const SurfaceHit> hits) {
  touched_.clear();
  ++scan_;
  if (scan_ == 0) {  // wrapped: old marks must not look new
    for (SurfaceFace& face : faces_) face.touched_scan = 0;
    scan_ = 1;
  }
  for (const SurfaceHit& hit : hits) {
    const int ix = surface_index(hit.x);
    const int iy = surface_index(hit.y);
    if (!in_surface(ix, iy)) continue;
    const std::uint16_t f = ensure_face(ix, iy, hit.view_x, hit.view_y);
    if (f == 0) continue;
    SurfaceFace& face = faces_[f];
    const float dx = hit.x - surface_centre(ix);
    const float dy = hit.y - surface_centre(iy);
    face.n += 1.0F;
    face.sum_x += dx;
    face.sum_y += dy;
    face.sum_xx += dx * dx;
    face.sum_xy += dx * dy;
    face.sum_yy += dy * dy;
    face.view_x += hit.view_x;
    face.view_y += hit.view_y;
    face.view_sectors = static_cast<std::uint8_t>(face.view_sectors | (1U << octant(hit.view_x, hit.view_y)));
    if (face.touched_scan != scan_) {
      face.touched_scan = scan_;
      if (face.keyframes < std::numeric_limits<std::uint16_t>::max()) ++face.keyframes;
      if (touched_.size() < touched_.capacity()) touched_.push_back(f);
    }
    face.pending += 1.0F;
  }
  for (const std::uint16_t t : touched_) {
    SurfaceFace& face = faces_[t];
    if (face.n > kMaxHits) {
      for (float* s :
           {&face.n, &face.sum_x, &face.sum_y, &face.sum_xx, &face.sum_xy, &face.sum_yy, &face.view_x, &face.view_y}) {
        *s *= 0.5F;
      }
    }
    const int ix = static_cast<int>(face.cell % kSurfaceSide);
    const int iy = static_cast<int>(face.cell / kSurfaceSide);
    const float norm = std::hypot(face.view_x, face.view_y);
    const float vx = norm > 0.0F ? face.view_x / norm : 0.0F;
    const float vy = norm > 0.0F ? face.view_y / norm : 0.0F;
    const float added = face.pending;
    face.pending = 0.0F;
    for (int ny = iy - 1; ny <= iy + 1; ++ny) {
      for (int nx = ix - 1; nx <= ix + 1; ++nx) {
        const std::uint16_t f = in_surface(nx, ny) ? ensure_face(nx, ny, vx, vy) : std::uint16_t{0};
        if (f == 0) continue;
        faces_[f].pending += added;
      }
    }
  }
  for (const std::uint16_t t : touched_) {
    const int ix = static_cast<int>(faces_[t].cell % kSurfaceSide);
    const int iy = static_cast<int>(faces_[t].cell / kSurfaceSide);
    for (int ny = iy - 1; ny <= iy + 1; ++ny) {
      for (int nx = ix - 1; nx <= ix + 1; ++nx) {
        for (std::uint16_t f = blocks_[directory_[block_index(nx, ny)]].slot[slot_index(nx, ny)]; f != 0;
             f = faces_[f].other) {
          if (faces_[f].pending > 0.1F * faces_[f].pooled.count) refresh(faces_[f]);
        }
      }
    }
  }
}

void SurfaceMap::refresh(SurfaceFace& face) {
  const int ix = static_cast<int>(face.cell % kSurfaceSide);
  const int iy = static_cast<int>(face.cell / kSurfaceSide);
  const float norm = std::hypot(face.view_x, face.view_y);
  const float vx = norm > 0.0F ? face.view_x / norm : 0.0F;
  const float vy = norm > 0.0F ? face.view_y / norm : 0.0F;
  const auto cell = static_cast<float>(kSurfaceCell_m);
  std::uint16_t scans = 0;
  float n = 0.0F;
  float sx = 0.0F;
  float sy = 0.0F;
  float sxx = 0.0F;
  float sxy = 0.0F;
  float syy = 0.0F;
  for (int ny = iy - 1; ny <= iy + 1; ++ny) {
    for (int nx = ix - 1; nx <= ix + 1; ++nx) {
      const std::uint16_t f = find_face(nx, ny, vx, vy);
      if (f == 0 || faces_[f].n <= 0.0F) continue;
      const SurfaceFace& g = faces_[f];
      const float ox = static_cast<float>(nx - ix) * cell;  // shift of the moments to this cell's centre
      const float oy = static_cast<float>(ny - iy) * cell;
      n += g.n;
      scans = std::max(scans, g.keyframes);
      sx += g.sum_x + g.n * ox;
      sy += g.sum_y + g.n * oy;
      sxx += g.sum_xx + 2.0F * ox * g.sum_x + g.n * ox * ox;
      sxy += g.sum_xy + ox * g.sum_y + oy * g.sum_x + g.n * ox * oy;
      syy += g.sum_yy + 2.0F * oy * g.sum_y + g.n * oy * oy;
    }
  }
  face.pending = 0.0F;
  PooledLine& line = face.pooled;
  line.count = n;
  line.scans = scans;
  if (n < 1.0F) {
    line.kind = SurfaceKind::kNone;
    return;
  }
  const float mx = sx / n;
  const float my = sy / n;
  const float cxx = std::max(sxx / n - mx * mx, 0.0F);
  const float cyy = std::max(syy / n - my * my, 0.0F);
  const float cxy = sxy / n - mx * my;
  line.mean_x = surface_centre(ix) + mx;
  line.mean_y = surface_centre(iy) + my;
  // Eigenvalues of the 2 x 2 scatter, closed form.
  const float mean = 0.5F * (cxx + cyy);
  const float root = std::hypot(0.5F * (cxx - cyy), cxy);
  const float large = mean + root;
  const float small = std::max(mean - root, 0.0F);
  line.half_length_m = std::sqrt(large);
  if (n < kMinHitsForLine || large < kMinLineSpread_m2 || small > kLineRatio * large) {
    line.kind = SurfaceKind::kPoint;
    line.normal_x = line.normal_y = 0.0F;
    line.sigma_m = std::sqrt(mean);
    return;
  }
  const float angle = 0.5F * std::atan2(2.0F * cxy, cxx - cyy);  // of the direction along the line
  float nx = -std::sin(angle);
  float ny = std::cos(angle);
  if (nx * face.view_x + ny * face.view_y < 0.0F) {
    nx = -nx;
    ny = -ny;
  }
  line.kind = SurfaceKind::kLine;
  line.normal_x = nx;
  line.normal_y = ny;
  line.sigma_m = std::sqrt(small);
}

void SurfaceMap::forget(double x_m, double y_m) {
  const int ix = surface_index(static_cast<float>(x_m));
  const int iy = surface_index(static_cast<float>(y_m));
  if (!in_surface(ix, iy)) return;
  for (std::uint16_t f = blocks_[directory_[block_index(ix, iy)]].slot[slot_index(ix, iy)]; f != 0;
       f = faces_[f].other) {
    SurfaceFace& face = faces_[f];
    face.n = face.sum_x = face.sum_y = face.sum_xx = face.sum_xy = face.sum_yy = 0.0F;
    face.keyframes = 0;
    face.view_sectors = 0;
  }
  for (int ny = iy - 1; ny <= iy + 1; ++ny) {
    for (int nx = ix - 1; nx <= ix + 1; ++nx) {
      for (std::uint16_t f = blocks_[directory_[block_index(nx, ny)]].slot[slot_index(nx, ny)]; f != 0;
           f = faces_[f].other) {
        refresh(faces_[f]);
      }
    }
  }
}

const PooledLine* SurfaceMap::find(float x_m, float y_m, float view_x, float view_y) const {
  const int ix = surface_index(x_m);
  const int iy = surface_index(y_m);
  if (!in_surface(ix, iy)) return nullptr;
  const std::uint16_t f = find_face(ix, iy, view_x, view_y);
  if (f == 0 || faces_[f].pooled.kind == SurfaceKind::kNone) return nullptr;
  return &faces_[f].pooled;
}

std::size_t SurfaceMap::bytes_used() const {
  return used_faces_ * sizeof(SurfaceFace) + used_blocks_ * sizeof(Block);
}

std::size_t SurfaceMap::bytes_limit() const {
  return faces_.size() * sizeof(SurfaceFace) + blocks_.size() * sizeof(Block);
}

}  // namespace submapd
