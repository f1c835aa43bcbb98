#include "slam/grid/surface_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "slam/base/planar_scatter.hpp"

namespace submapd {
namespace {

constexpr float kMaxHits = 2000.0F;         // halve beyond: finite inertia against moved walls
constexpr float kSameSide = -0.17F;         // cosine: views up to 100 deg apart belong to one face
constexpr float kSameNormal = 0.7F;         // cosine: 45 deg
constexpr float kLineRatio = 0.1F;          // smaller to larger eigenvalue of a line's scatter
constexpr float kMinLineSpread_m2 = 4e-4F;  // (2 cm)^2 along a line at least
constexpr float kMinHitsForLine = 3.0F;
constexpr float kNormalsForLine = 5.0F;  // hits whose scan told a normal, that tell a line's direction ...
constexpr float kAgree = 0.97F;          // ... if that of the scatter is not within 14 deg of it
constexpr float kFewHits = 5.0F;         // make no line of a cell alone
constexpr float kWider = 1.2F;           // mean square off a line through nine cells over that through one ...
constexpr float kWider_m2 = 1.6e-5F;     // ... and (4 mm)^2: more is no straight wall
constexpr float kAsIfHits = 4.0F;        // so many of kOfHits_m2 are seen before any
constexpr float kOfHits_m2 = 1.4e-4F;    // (12 mm)^2: mean square of hits off a wall
constexpr float kLeastShare = 0.05F;     // of the hits in its cells, for a face

// Whether the view (a unit vector) and the face's look at one side: cosine above kSameSide.
bool same_side(const SurfaceFace& face, float view_x, float view_y) {
  const float dot = face.view_x * view_x + face.view_y * view_y;
  if (dot >= 0.0F) return true;
  const float square = face.view_x * face.view_x + face.view_y * face.view_y;
  return dot * dot < kSameSide * kSameSide * square;
}

// Nothing here is so long or so short that std::hypot's care pays for its time.
float norm_of(float x, float y) {
  return std::sqrt(x * x + y * y);
}

// Whether what is seen so is the face: by their normals where both are known, else by the side.
bool same_face(const SurfaceFace& face, const SurfaceLook& look) {
  const float dot = face.normal_x * look.normal_x + face.normal_y * look.normal_y;
  if (dot != 0.0F) {
    if (dot < 0.0F) return false;
    const float square = face.normal_x * face.normal_x + face.normal_y * face.normal_y;
    return dot * dot > kSameNormal * kSameNormal * square;
  }
  return same_side(face, look.view_x, look.view_y);
}

// Unit views and normals of a face.
SurfaceLook look_of(const SurfaceFace& face) {
  SurfaceLook look;
  if (const float norm = norm_of(face.view_x, face.view_y); norm > 0.0F) {
    look.view_x = face.view_x / norm;
    look.view_y = face.view_y / norm;
  }
  if (const float norm = norm_of(face.normal_x, face.normal_y); norm > 0.0F) {
    look.normal_x = face.normal_x / norm;
    look.normal_y = face.normal_y / norm;
  }
  return look;
}

// Which eighth of the circle a direction lies in, counted from +x.
unsigned octant(float x, float y) {
  if (y >= 0.0F) return x > 0.0F ? (y < x ? 0U : 1U) : (y > -x ? 2U : 3U);
  return x < 0.0F ? (-y < -x ? 4U : 5U) : (-y > x ? 6U : 7U);
}

// Sums over the hits of several faces, about the centre of one cell.
struct Moments {
  float n = 0.0F;
  float x = 0.0F;
  float y = 0.0F;
  float xx = 0.0F;
  float xy = 0.0F;
  float yy = 0.0F;
  float normal_x = 0.0F;
  float normal_y = 0.0F;
  float in_free = 0.0F;
  std::uint16_t scans = 0;  // of the face that most scans hit

  // dx, dy: cells from that cell to the face's.
  void add(const SurfaceFace& f, int dx, int dy) {
    if (f.n <= 0.0F) return;
    const float ox = static_cast<float>(dx) * static_cast<float>(kSurfaceCell_m);
    const float oy = static_cast<float>(dy) * static_cast<float>(kSurfaceCell_m);
    scans = std::max(scans, f.keyframes);
    n += f.n;
    in_free += f.in_free;
    normal_x += f.normal_x;
    normal_y += f.normal_y;
    x += f.sum_x + f.n * ox;
    y += f.sum_y + f.n * oy;
    xx += f.sum_xx + 2.0F * ox * f.sum_x + f.n * ox * ox;
    xy += f.sum_xy + ox * f.sum_y + oy * f.sum_x + f.n * ox * oy;
    yy += f.sum_yy + 2.0F * oy * f.sum_y + f.n * oy * oy;
  }
};

// Spread off a line whose mean square over n hits is off_m2: few of them lie close to their own line by chance.
float spread_m(float off_m2, float n) {
  return std::sqrt((n * off_m2 + kAsIfHits * kOfHits_m2) / (std::max(n - 2.0F, 0.0F) + kAsIfHits));
}

// Line through them, or a point where they make none; its normal towards who sees the face. What is short (a jamb) or
// in steps has the direction that the single scans saw: the scatter of 6 cm with noise says none, that of a wall and
// the door that stands back behind it a wrong one.
PooledLine line_of(const Moments& m, const SurfaceFace& face) {
  PooledLine line;
  line.count = m.n;
  line.scans = m.scans;
  line.moved = 2.0F * m.in_free > m.n;
  if (m.n < 1.0F) return line;
  const float mx = m.x / m.n;
  const float my = m.y / m.n;
  const PlanarScatter scatter{std::max(m.xx / m.n - mx * mx, 0.0F), m.xy / m.n - mx * my,
                              std::max(m.yy / m.n - my * my, 0.0F)};
  line.mean_x = surface_centre(static_cast<int>(face.cell % kSurfaceSide)) + mx;
  line.mean_y = surface_centre(static_cast<int>(face.cell / kSurfaceSide)) + my;
  const ScatterValues values = eigenvalues(scatter);
  const float small = std::max(values.small, 0.0F);
  line.half_length_m = std::sqrt(values.large);
  const float normals = norm_of(m.normal_x, m.normal_y);
  const bool told = normals >= kNormalsForLine;
  bool by_scatter = m.n >= kMinHitsForLine && values.large >= kMinLineSpread_m2 && small <= kLineRatio * values.large;
  if (by_scatter) {
    const auto [nx, ny] = normal_of(scatter, values.small);
    const float scale = std::copysign(1.0F / norm_of(nx, ny), nx * face.view_x + ny * face.view_y);
    line.normal_x = scale * nx;
    line.normal_y = scale * ny;
    line.sigma_m = spread_m(small, m.n);
    by_scatter = !told || std::abs(line.normal_x * m.normal_x + line.normal_y * m.normal_y) >= kAgree * normals;
  }
  if (!by_scatter && !told) {
    line.kind = SurfaceKind::kPoint;
    line.sigma_m = std::sqrt(0.5F * (scatter.xx + scatter.yy));
    return line;
  }
  line.kind = SurfaceKind::kLine;
  if (by_scatter) return line;
  line.normal_x = m.normal_x / normals;
  line.normal_y = m.normal_y / normals;
  const float off_m2 = line.normal_x * line.normal_x * scatter.xx + 2.0F * line.normal_x * line.normal_y * scatter.xy +
                       line.normal_y * line.normal_y * scatter.yy;
  line.sigma_m = spread_m(std::max(off_m2, 0.0F), m.n);
  return line;
}

// The hits around lie no farther from their line than those of the cell from theirs.
bool straight(const PooledLine& pooled, const PooledLine& own) {
  if (pooled.kind != SurfaceKind::kLine) return false;
  // A cell on whose border the wall lies holds half of its hits, and those lie closer together than hits do.
  const float of_own = std::max(own.sigma_m * own.sigma_m, kOfHits_m2);
  return pooled.sigma_m * pooled.sigma_m <= kWider * of_own + kWider_m2;
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

std::uint16_t SurfaceMap::find_face(int ix, int iy, const SurfaceLook& look) const {
  std::uint16_t f = blocks_[directory_[block_index(ix, iy)]].slot[slot_index(ix, iy)];
  while (f != 0) {
    if (same_face(faces_[f], look)) return f;
    f = faces_[f].other;
  }
  return 0;
}

std::uint16_t SurfaceMap::ensure_face(int ix, int iy, const SurfaceLook& look) {
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
    if (same_face(faces_[*link], look)) return *link;
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
  constexpr float kHint = 1e-3F;  // until the cell has hits of its own
  face.view_x = look.view_x * kHint;
  face.view_y = look.view_y * kHint;
  face.normal_x = look.normal_x * kHint;
  face.normal_y = look.normal_y * kHint;
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
    const std::uint16_t f = ensure_face(ix, iy, hit.look);
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
    face.view_x += hit.look.view_x;
    face.view_y += hit.look.view_y;
    face.normal_x += hit.look.normal_x;
    face.normal_y += hit.look.normal_y;
    face.in_free += hit.in_free ? 1.0F : 0.0F;
    face.view_sectors = static_cast<std::uint8_t>(face.view_sectors | (1U << octant(hit.look.view_x, hit.look.view_y)));
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
      for (float* s : {&face.n, &face.sum_x, &face.sum_y, &face.sum_xx, &face.sum_xy, &face.sum_yy, &face.view_x,
                       &face.view_y, &face.in_free, &face.normal_x, &face.normal_y}) {
        *s *= 0.5F;
      }
    }
    const int ix = static_cast<int>(face.cell % kSurfaceSide);
    const int iy = static_cast<int>(face.cell / kSurfaceSide);
    const SurfaceLook look = look_of(face);
    const float added = face.pending;
    face.pending = 0.0F;
    for (int ny = iy - 1; ny <= iy + 1; ++ny) {
      for (int nx = ix - 1; nx <= ix + 1; ++nx) {
        const std::uint16_t f = in_surface(nx, ny) ? ensure_face(nx, ny, look) : std::uint16_t{0};
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

float SurfaceMap::hits_of_side(int ix, int iy, const SurfaceLook& look) const {
  float hits = 0.0F;
  for (std::uint16_t f = blocks_[directory_[block_index(ix, iy)]].slot[slot_index(ix, iy)]; f != 0;
       f = faces_[f].other) {
    if (same_side(faces_[f], look.view_x, look.view_y)) hits += faces_[f].n;
  }
  return hits;
}

void SurfaceMap::refresh(SurfaceFace& face) {
  const int ix = static_cast<int>(face.cell % kSurfaceSide);
  const int iy = static_cast<int>(face.cell / kSurfaceSide);
  const SurfaceLook look = look_of(face);
  Moments all;
  float beside = 0.0F;  // all hits in the cells with hits of this face
  for (int ny = iy - 1; ny <= iy + 1; ++ny) {
    for (int nx = ix - 1; nx <= ix + 1; ++nx) {
      const std::uint16_t f = find_face(nx, ny, look);
      if (f == 0 || faces_[f].n <= 0.0F) continue;
      all.add(faces_[f], nx - ix, ny - iy);
      beside += hits_of_side(nx, ny, look);
    }
  }
  Moments own;
  own.add(face, 0, 0);
  face.pending = 0.0F;
  face.pooled = line_of(all, face);
  face.own = own.n < kFewHits ? PooledLine{} : line_of(own, face);
  if (straight(face.pooled, face.own)) face.own.kind = SurfaceKind::kNone;
  // The few hits on a wall whose neighbours happened to lie askew are no face of it.
  if (all.n < kLeastShare * beside) face.pooled.kind = face.own.kind = SurfaceKind::kNone;
}

void SurfaceMap::forget(double x_m, double y_m) {
  const int ix = surface_index(static_cast<float>(x_m));
  const int iy = surface_index(static_cast<float>(y_m));
  if (!in_surface(ix, iy)) return;
  for (std::uint16_t f = blocks_[directory_[block_index(ix, iy)]].slot[slot_index(ix, iy)]; f != 0;
       f = faces_[f].other) {
    SurfaceFace& face = faces_[f];
    face.n = face.sum_x = face.sum_y = face.sum_xx = face.sum_xy = face.sum_yy = face.in_free = 0.0F;
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

const SurfaceFace* SurfaceMap::face_at(float x_m, float y_m, const SurfaceLook& look) const {
  const int ix = surface_index(x_m);
  const int iy = surface_index(y_m);
  if (!in_surface(ix, iy)) return nullptr;
  const std::uint16_t f = find_face(ix, iy, look);
  return f == 0 ? nullptr : &faces_[f];
}

std::size_t SurfaceMap::bytes_used() const {
  return used_faces_ * sizeof(SurfaceFace) + used_blocks_ * sizeof(Block);
}

std::size_t SurfaceMap::bytes_limit() const {
  return faces_.size() * sizeof(SurfaceFace) + blocks_.size() * sizeof(Block);
}

}  // namespace submapd
