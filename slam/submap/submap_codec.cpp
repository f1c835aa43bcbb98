#include "slam/submap/submap_codec.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include "slam/base/byte_io.hpp"
#include "slam/submap/submap_check.hpp"

namespace submapd {
namespace {

constexpr std::size_t kSections = 4;
constexpr std::size_t kHeaderBytes = 24;         // magic, version, number of sections, total length
constexpr std::size_t kSectionHeaderBytes = 16;  // number, CRC, length
constexpr std::size_t kTrailerBytes = 4;         // CRC
constexpr std::size_t kPoseBytes = 24;
constexpr std::size_t kGeometryBytes = 5 * 8 + kPoseBytes;
constexpr std::size_t kKeyframeBytes = 16 + 2 * kPoseBytes + 72 + 1 + kGeometryBytes + 4;  // without its ranges
constexpr std::size_t kBlockBytes = 8 + kBlockCells * kBlockCells;
constexpr std::size_t kSurfaceBytes = 25;

std::uint32_t crc_of(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(crc32_z(0, nullptr, 0), reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

void put(ByteWriter& out, const Pose2& pose) {
  out.put(pose.x);
  out.put(pose.y);
  out.put(pose.yaw);
}

Pose2 get_pose(ByteReader& in) {
  Pose2 pose;
  pose.x = in.get_f64();
  pose.y = in.get_f64();
  pose.yaw = in.get_f64();
  return pose;
}

// A boolean has one form each, so that bytes that decode encode to themselves; `sound` is cleared for any other.
bool get_bool(ByteReader& in, bool& sound) {
  const std::uint8_t value = in.get<std::uint8_t>();
  if (value > 1) sound = false;
  return value == 1;
}

void put(ByteWriter& out, const ScanGeometry& geometry) {
  out.put(geometry.first_angle_rad);
  out.put(geometry.angle_step_rad);
  out.put(geometry.sweep_s);
  out.put(geometry.range_min_m);
  out.put(geometry.range_max_m);
  put(out, geometry.base_from_sensor);
}

ScanGeometry get_geometry(ByteReader& in) {
  ScanGeometry geometry;
  geometry.first_angle_rad = in.get_f64();
  geometry.angle_step_rad = in.get_f64();
  geometry.sweep_s = in.get_f64();
  geometry.range_min_m = in.get_f64();
  geometry.range_max_m = in.get_f64();
  geometry.base_from_sensor = get_pose(in);
  return geometry;
}

void put_head(ByteWriter& out, const FinishedSubmap& submap) {
  out.put(std::span<const std::uint8_t>(submap.id.cart.bytes));
  out.put(std::span<const std::uint8_t>(submap.id.run.bytes));
  out.put(submap.id.index);
  put(out, submap.odom_from_submap);
  out.put(static_cast<std::uint8_t>(submap.reason));
  out.put(submap.cell_m);
  out.put(submap.linked_to_previous);
}

std::string_view get_head(ByteReader& in, FinishedSubmap& submap) {
  bool sound = true;
  for (std::uint8_t& byte : submap.id.cart.bytes) byte = in.get<std::uint8_t>();
  for (std::uint8_t& byte : submap.id.run.bytes) byte = in.get<std::uint8_t>();
  submap.id.index = in.get<std::uint32_t>();
  submap.odom_from_submap = get_pose(in);
  submap.reason = static_cast<FinishReason>(in.get<std::uint8_t>());
  submap.cell_m = in.get_f64();
  submap.linked_to_previous = get_bool(in, sound);
  if (!sound) return "boolean neither 0 nor 1";
  return head_problem(submap);
}

void put_item(ByteWriter& out, const Keyframe& keyframe) {
  out.put(keyframe.scan_index);
  out.put(keyframe.stamp_us);
  put(out, keyframe.pose);
  out.put(keyframe.twist.vx);
  out.put(keyframe.twist.vy);
  out.put(keyframe.twist.wz);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) out.put(keyframe.step_covariance(row, column));
  }
  out.put(keyframe.degenerate);
  put(out, keyframe.geometry);
  out.put(static_cast<std::uint32_t>(keyframe.ranges_mm.size()));
  for (const std::uint16_t range_mm : keyframe.ranges_mm) out.put(range_mm);
}

// Each get_item() returns what its bytes cannot say, or nothing; what the values may not be is submap_check's.
std::string_view get_item(ByteReader& in, Keyframe& keyframe) {
  bool sound = true;
  keyframe.scan_index = in.get<std::uint64_t>();
  keyframe.stamp_us = in.get_i64();
  keyframe.pose = get_pose(in);
  keyframe.twist.vx = in.get_f64();
  keyframe.twist.vy = in.get_f64();
  keyframe.twist.wz = in.get_f64();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) keyframe.step_covariance(row, column) = in.get_f64();
  }
  keyframe.degenerate = get_bool(in, sound);
  if (!sound) return "boolean neither 0 nor 1";
  keyframe.geometry = get_geometry(in);
  const std::uint32_t beams = in.get<std::uint32_t>();
  if (beams > kMaxBeams) return "too many beams";
  if (!in.fits(beams, 2)) return "ranges longer than their section";
  keyframe.ranges_mm.resize(beams);
  for (std::uint16_t& range_mm : keyframe.ranges_mm) range_mm = in.get<std::uint16_t>();
  return {};
}

void put_item(ByteWriter& out, const OccupancyBlock& block) {
  out.put(block.bx);
  out.put(block.by);
  out.put(std::span<const std::uint8_t>(block.cells));
}

std::string_view get_item(ByteReader& in, OccupancyBlock& block) {
  block.bx = in.get_i32();
  block.by = in.get_i32();
  const std::span<const std::byte> cells = in.get_bytes(block.cells.size());
  std::transform(cells.begin(), cells.end(), block.cells.begin(),
                 [](std::byte cell) { return static_cast<std::uint8_t>(cell); });
  return {};
}

void put_item(ByteWriter& out, const SurfacePoint& point) {
  out.put(point.x);
  out.put(point.y);
  out.put(point.normal_x);
  out.put(point.normal_y);
  out.put(point.sigma_m);
  out.put(point.hits);
  out.put(point.keyframes);
  out.put(point.view_sectors);
}

std::string_view get_item(ByteReader& in, SurfacePoint& point) {
  point.x = in.get_f32();
  point.y = in.get_f32();
  point.normal_x = in.get_f32();
  point.normal_y = in.get_f32();
  point.sigma_m = in.get_f32();
  point.hits = in.get<std::uint16_t>();
  point.keyframes = in.get<std::uint16_t>();
  point.view_sectors = in.get<std::uint8_t>();
  return {};
}

template <typename T>
void put_list(ByteWriter& out, const std::vector<T>& items) {
  out.put(static_cast<std::uint32_t>(items.size()));
  for (const T& item : items) put_item(out, item);
}

template <typename T>
std::string_view get_list(ByteReader& in, std::size_t item_bytes, std::vector<T>& items) {
  const std::uint32_t count = in.get<std::uint32_t>();
  if (!in.fits(count, item_bytes)) return "list longer than its section";
  items.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (const std::string_view problem = get_item(in, items[i]); !problem.empty()) return problem;
    if (!in.ok()) return "list longer than its section";
    if (const std::string_view problem = problem_of(items[i], i == 0 ? nullptr : &items[i - 1]); !problem.empty()) {
      return problem;
    }
  }
  return {};
}

std::string_view get_section(std::size_t number, ByteReader& in, FinishedSubmap& submap) {
  switch (number) {
    case 1:
      return get_head(in, submap);
    case 2: {
      const std::string_view problem = get_list(in, kKeyframeBytes, submap.keyframes);
      return problem.empty() && submap.keyframes.empty() ? "no key-frame" : problem;
    }
    case 3:
      return get_list(in, kBlockBytes, submap.blocks);
    default:
      return get_list(in, kSurfaceBytes, submap.surface);
  }
}

tl::unexpected<Status> corrupt(std::size_t offset, std::string_view what) {
  return failure(StatusCode::kCorrupt, fmt::format("sub-map, byte {}: {}", offset, what));
}

}  // namespace

std::vector<std::byte> encode_submap(const FinishedSubmap& submap) {
  std::array<ByteWriter, kSections> sections;
  put_head(sections[0], submap);
  put_list(sections[1], submap.keyframes);
  put_list(sections[2], submap.blocks);
  put_list(sections[3], submap.surface);

  std::uint64_t total = kHeaderBytes + kTrailerBytes;
  for (const ByteWriter& section : sections) total += kSectionHeaderBytes + section.bytes().size();

  ByteWriter out;
  out.put(std::as_bytes(std::span(kSubmapMagic)));
  out.put(kSubmapFormatVersion);
  out.put(static_cast<std::uint32_t>(kSections));
  out.put(total);
  for (std::size_t i = 0; i < kSections; ++i) {
    const std::span<const std::byte> payload = sections[i].bytes();
    out.put(static_cast<std::uint32_t>(i + 1));
    out.put(crc_of(payload));
    out.put(static_cast<std::uint64_t>(payload.size()));
    out.put(payload);
  }
  out.put(crc_of(out.bytes()));
  return out.take();
}

Expected<FinishedSubmap> decode_submap(std::span<const std::byte> bytes) {
  if (bytes.size() > kMaxEncodedSubmapBytes) return corrupt(kMaxEncodedSubmapBytes, "longer than any sub-map");
  if (bytes.size() < kHeaderBytes + kTrailerBytes) return corrupt(bytes.size(), "cut short");
  const std::span<const std::byte> magic = std::as_bytes(std::span(kSubmapMagic));
  if (!std::equal(magic.begin(), magic.end(), bytes.begin())) return corrupt(0, "not a sub-map: wrong magic");

  ByteReader in(bytes.first(bytes.size() - kTrailerBytes));
  (void)in.get_bytes(kSubmapMagic.size());
  const std::uint32_t version = in.get<std::uint32_t>();
  if (version != kSubmapFormatVersion) {
    return corrupt(8, fmt::format("format version {}, this program reads {}", version, kSubmapFormatVersion));
  }
  if (in.get<std::uint32_t>() != kSections) return corrupt(12, "wrong number of sections");
  if (in.get<std::uint64_t>() != bytes.size()) return corrupt(16, "length does not match the header: cut short?");
  ByteReader trailer(bytes.last(kTrailerBytes));
  if (trailer.get<std::uint32_t>() != crc_of(bytes.first(bytes.size() - kTrailerBytes))) {
    return corrupt(bytes.size() - kTrailerBytes, "checksum of the whole does not match");
  }

  FinishedSubmap submap;
  for (std::size_t number = 1; number <= kSections; ++number) {
    const std::size_t header_offset = in.position();
    const std::uint32_t found = in.get<std::uint32_t>();
    const std::uint32_t crc = in.get<std::uint32_t>();
    const std::uint64_t length = in.get<std::uint64_t>();
    if (!in.ok() || found != number) return corrupt(header_offset, fmt::format("section {} expected", number));
    if (!in.fits(length, 1)) return corrupt(header_offset + 8, "section longer than the file");
    const std::size_t offset = in.position();
    const std::span<const std::byte> payload = in.get_bytes(static_cast<std::size_t>(length));
    if (crc != crc_of(payload)) return corrupt(offset, fmt::format("checksum of section {} does not match", number));
    ByteReader section(payload);
    if (const std::string_view problem = get_section(number, section, submap); !problem.empty()) {
      return corrupt(offset + section.position(), fmt::format("section {}: {}", number, problem));
    }
    if (!section.ok() || section.remaining() != 0) {
      return corrupt(offset + section.position(), fmt::format("section {} has a wrong length", number));
    }
  }
  if (in.remaining() != 0) return corrupt(in.position(), "bytes after the last section");
  return submap;
}

std::size_t memory_bytes(const FinishedSubmap& submap) {
  std::size_t bytes = sizeof(FinishedSubmap) + submap.keyframes.capacity() * sizeof(Keyframe) +
                      submap.blocks.capacity() * sizeof(OccupancyBlock) +
                      submap.surface.capacity() * sizeof(SurfacePoint);
  for (const Keyframe& keyframe : submap.keyframes) bytes += keyframe.ranges_mm.capacity() * sizeof(std::uint16_t);
  return bytes;
}

}  // namespace submapd
