#include "slam/submap/submap_codec.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "slam/submap/submap_check.hpp"
#include "tests/support/random_submap.hpp"

namespace submapd {
namespace {

const SubmapId kId{Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), 7};

void put_u32(std::vector<std::byte>& bytes, std::size_t offset, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[offset + i] = static_cast<std::byte>((value >> (8 * i)) & 0xFF);
}

std::uint32_t get_u32(const std::vector<std::byte>& bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) value |= static_cast<std::uint32_t>(bytes[offset + i]) << (8 * i);
  return value;
}

std::uint32_t crc(const std::vector<std::byte>& bytes, std::size_t offset, std::size_t length) {
  return static_cast<std::uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data() + offset), static_cast<uInt>(length)));
}

// Offset of the payload of a section, and its length.
std::pair<std::size_t, std::size_t> section(const std::vector<std::byte>& bytes, std::size_t number) {
  std::size_t offset = 24;
  for (std::size_t i = 1; i < number; ++i) offset += 16 + get_u32(bytes, offset + 8);
  return {offset + 16, get_u32(bytes, offset + 8)};
}

// Makes all checksums right again, so that a changed value is judged as a value.
void seal(std::vector<std::byte>& bytes) {
  for (std::size_t number = 1; number <= 4; ++number) {
    const auto [offset, length] = section(bytes, number);
    put_u32(bytes, offset - 12, crc(bytes, offset, length));
  }
  put_u32(bytes, bytes.size() - 4, crc(bytes, 0, bytes.size() - 4));
}

std::string error_of(const std::vector<std::byte>& bytes) {
  const Expected<FinishedSubmap> decoded = decode_submap(bytes);
  if (decoded) return "accepted";
  EXPECT_EQ(decoded.error().code(), StatusCode::kCorrupt);
  return decoded.error().message();
}

RC_GTEST_PROP(SubmapCodec, ComesBackAsItWas, (std::uint64_t seed, std::uint32_t index)) {
  SubmapSizes sizes;
  sizes.keyframes = *rc::gen::inRange<std::size_t>(1, 6);
  sizes.beams = *rc::gen::inRange<std::size_t>(0, 200);
  sizes.blocks = *rc::gen::inRange<std::size_t>(0, 7);
  sizes.surface = *rc::gen::inRange<std::size_t>(0, 50);
  const FinishedSubmap submap = random_submap(seed, {kId.cart, kId.run, index}, sizes);
  RC_ASSERT(check_submap(submap).ok());
  const std::vector<std::byte> bytes = encode_submap(submap);
  const Expected<FinishedSubmap> decoded = decode_submap(bytes);
  RC_ASSERT(decoded.has_value());
  RC_ASSERT(encode_submap(*decoded) == bytes);

  RC_ASSERT(decoded->id == submap.id);
  RC_ASSERT(decoded->odom_from_submap == submap.odom_from_submap);
  RC_ASSERT(decoded->reason == submap.reason);
  RC_ASSERT(decoded->cell_m == submap.cell_m);
  RC_ASSERT(decoded->linked_to_previous == submap.linked_to_previous);
  RC_ASSERT(decoded->keyframes.size() == submap.keyframes.size());
  for (std::size_t i = 0; i < submap.keyframes.size(); ++i) {
    const Keyframe& a = submap.keyframes[i];
    const Keyframe& b = decoded->keyframes[i];
    RC_ASSERT(a.scan_index == b.scan_index && a.stamp_us == b.stamp_us && a.pose == b.pose && a.twist == b.twist);
    RC_ASSERT(a.step_covariance == b.step_covariance && a.degenerate == b.degenerate && a.geometry == b.geometry);
    RC_ASSERT(a.ranges_mm == b.ranges_mm);
  }
  RC_ASSERT(decoded->blocks.size() == submap.blocks.size());
  for (std::size_t i = 0; i < submap.blocks.size(); ++i) {
    RC_ASSERT(decoded->blocks[i].bx == submap.blocks[i].bx && decoded->blocks[i].by == submap.blocks[i].by);
    RC_ASSERT(decoded->blocks[i].cells == submap.blocks[i].cells);
  }
  RC_ASSERT(decoded->surface.size() == submap.surface.size());
  for (std::size_t i = 0; i < submap.surface.size(); ++i) {
    const SurfacePoint& a = submap.surface[i];
    const SurfacePoint& b = decoded->surface[i];
    RC_ASSERT(a.x == b.x && a.y == b.y && a.normal_x == b.normal_x && a.normal_y == b.normal_y);
    RC_ASSERT(a.sigma_m == b.sigma_m && a.hits == b.hits && a.keyframes == b.keyframes);
    RC_ASSERT(a.view_sectors == b.view_sectors);
  }
}

// The page says where things lie; a change of it is a new version.
TEST(SubmapCodec, LayoutOfVersionOne) {
  const std::vector<std::byte> bytes = encode_submap(random_submap(1, kId, {1, 2, 1, 1}));
  EXPECT_EQ(std::memcmp(bytes.data(), "SUBMAPD\n", 8), 0);
  EXPECT_EQ(get_u32(bytes, 8), 1U);
  EXPECT_EQ(get_u32(bytes, 12), 4U);
  EXPECT_EQ(get_u32(bytes, 16), bytes.size());
  EXPECT_EQ(section(bytes, 1), (std::pair<std::size_t, std::size_t>(40, 70)));
  EXPECT_EQ(get_u32(bytes, 40 + 32), kId.index);
  EXPECT_EQ(section(bytes, 2).second, 4U + 16 + 24 + 24 + 72 + 1 + 64 + 4 + 2 * 2);
  EXPECT_EQ(section(bytes, 3).second, 4U + 8 + 4096);
  EXPECT_EQ(section(bytes, 4).second, 4U + 25);
}

TEST(SubmapCodec, EveryFlippedByteIsNoticed) {
  std::vector<std::byte> bytes = encode_submap(random_submap(2, kId, {2, 5, 0, 3}));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (const int mask : {0x01, 0x80, 0xFF}) {
      bytes[i] ^= static_cast<std::byte>(mask);
      EXPECT_NE(error_of(bytes), "accepted") << "byte " << i;
      bytes[i] ^= static_cast<std::byte>(mask);
    }
  }
  EXPECT_EQ(error_of(bytes), "accepted");
}

TEST(SubmapCodec, EveryCutIsNoticed) {
  const std::vector<std::byte> bytes = encode_submap(random_submap(3, kId, {2, 5, 0, 3}));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE(error_of({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}), "accepted") << size;
  }
  std::vector<std::byte> longer = bytes;
  longer.push_back(std::byte{0});
  EXPECT_NE(error_of(longer), "accepted");
}

// Checksums do not help against someone who makes them: each byte is changed and sealed again. What is still accepted
// must be another legal sub-map, with the same bytes.
TEST(SubmapCodec, EverySealedChangeIsRefusedOrLegal) {
  const std::vector<std::byte> original = encode_submap(random_submap(4, kId, {2, 3, 0, 3}));
  int accepted = 0;
  for (std::size_t number = 1; number <= 4; ++number) {
    const auto [offset, length] = section(original, number);
    for (std::size_t i = offset; i < offset + length; ++i) {
      std::vector<std::byte> bytes = original;
      bytes[i] ^= std::byte{0xFF};
      seal(bytes);
      const Expected<FinishedSubmap> decoded = decode_submap(bytes);
      if (!decoded) continue;
      ++accepted;
      EXPECT_TRUE(check_submap(*decoded).ok()) << "byte " << i;
      EXPECT_EQ(encode_submap(*decoded), bytes) << "byte " << i;
    }
  }
  EXPECT_GT(accepted, 0);
}

TEST(SubmapCodec, HugeCountsAreRefusedBeforeAllocation) {
  const std::vector<std::byte> original = encode_submap(random_submap(5, kId, {1, 3, 1, 1}));
  for (std::size_t number = 2; number <= 4; ++number) {
    std::vector<std::byte> bytes = original;
    put_u32(bytes, section(bytes, number).first, 0xFFFFFFFFU);
    seal(bytes);
    EXPECT_THAT(error_of(bytes), testing::HasSubstr("list longer than its section"));
  }
}

TEST(SubmapCodec, ErrorsNameOffsetAndReason) {
  std::vector<std::byte> bytes = encode_submap(random_submap(6, kId, {1, 3, 1, 1}));
  const auto [offset, length] = section(bytes, 1);
  bytes[offset + length - 1] = std::byte{2};
  seal(bytes);
  EXPECT_EQ(error_of(bytes), "sub-map, byte 110: section 1: boolean neither 0 nor 1");
}

TEST(SubmapCodec, IllegalValuesAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  using Change = std::function<void(FinishedSubmap&)>;
  const std::vector<std::pair<std::string, Change>> changes = {
      {"not finite", [&](FinishedSubmap& s) { s.odom_from_submap.x = nan; }},
      {"not finite", [&](FinishedSubmap& s) { s.keyframes[1].pose.yaw = infinity; }},
      {"not finite", [&](FinishedSubmap& s) { s.keyframes[1].pose.y = nan; }},
      {"cell size", [](FinishedSubmap& s) { s.cell_m = 0.0; }},
      {"finish reason", [](FinishedSubmap& s) { s.reason = static_cast<FinishReason>(9); }},
      {"no key-frame", [](FinishedSubmap& s) { s.keyframes.clear(); }},
      {"not the identity", [](FinishedSubmap& s) { s.keyframes[0].pose.x = 1e-9; }},
      {"order of time", [](FinishedSubmap& s) { std::swap(s.keyframes[1], s.keyframes[2]); }},
      {"not sorted", [](FinishedSubmap& s) { std::swap(s.blocks[0], s.blocks[1]); }},
      {"not distinct", [](FinishedSubmap& s) { s.blocks[1] = s.blocks[0]; }},
      {"block too far", [](FinishedSubmap& s) { s.blocks[1].bx = kMaxBlockIndex; }},
      {"too many beams", [](FinishedSubmap& s) { s.keyframes[0].ranges_mm.resize(kMaxBeams + 1); }},
      {"twist", [&](FinishedSubmap& s) { s.keyframes[0].twist.wz = nan; }},
      {"covariance", [](FinishedSubmap& s) { s.keyframes[0].step_covariance(1, 1) = -1.0; }},
      {"covariance", [&](FinishedSubmap& s) { s.keyframes[0].step_covariance(0, 1) = nan; }},
      {"geometry", [](FinishedSubmap& s) { s.keyframes[0].geometry.sweep_s = -0.1; }},
      {"geometry", [](FinishedSubmap& s) { s.keyframes[0].geometry.range_min_m = 31.0; }},
      {"normal", [](FinishedSubmap& s) { s.surface[0].normal_x = 2.0F; }},
      {"normal", [](FinishedSubmap& s) { s.surface[0].normal_y = std::numeric_limits<float>::quiet_NaN(); }},
      {"sigma", [](FinishedSubmap& s) { s.surface[0].sigma_m = -1.0F; }},
  };
  for (const auto& [what, change] : changes) {
    FinishedSubmap submap = random_submap(7, kId);
    change(submap);
    EXPECT_THAT(error_of(encode_submap(submap)), testing::HasSubstr(what));
    const Status status = check_submap(submap);
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
    EXPECT_THAT(status.message(), testing::HasSubstr(what));
  }
}

TEST(SubmapCodec, MemoryGrowsWithWhatItHolds) {
  const std::size_t small = memory_bytes(random_submap(8, kId, {1, 10, 0, 0}));
  const std::size_t more_blocks = memory_bytes(random_submap(8, kId, {1, 10, 4, 0}));
  const std::size_t more_beams = memory_bytes(random_submap(8, kId, {1, 1000, 0, 0}));
  EXPECT_GE(more_blocks, small + 4 * 4096);
  EXPECT_GE(more_beams, small + 990 * 2);
}

}  // namespace
}  // namespace submapd
