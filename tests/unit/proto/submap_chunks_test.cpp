#include "proto/submap_chunks.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "proto/lcm_message.hpp"
#include "slam/base/random.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd {
namespace {

const Uuid kCart = Uuid::from_seed(1, 1);
const Uuid kRun = Uuid::from_seed(1, 2);

std::vector<std::byte> noise(std::uint64_t seed, std::size_t size) {
  CounterRandom random(seed, size, 0);
  std::vector<std::byte> bytes(size);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random.next_u64() & 0xFF);
  return bytes;
}

std::vector<submap_chunk_t> cut(std::uint32_t index, const std::vector<std::byte>& raw) {
  return chunk_submap({kCart, kRun, index}, 5, raw, sha256_of(raw).value(), 0).value();
}

ChunkAssembler assembler(std::size_t limit = std::size_t{1} << 24) {
  return ChunkAssembler(
      kCart, kRun, [](std::uint32_t, const Sha256&) { return true; }, limit);
}

RC_GTEST_PROP(SubmapChunks, AnyOrderWithRepetitionsAndStrangersComesTogether, (std::uint64_t seed)) {
  const std::size_t submaps = *rc::gen::inRange<std::size_t>(1, 4);
  std::vector<std::vector<std::byte>> raw;
  std::vector<std::pair<std::uint64_t, submap_chunk_t>> messages;  // by a random key: the order of arrival
  CounterRandom random(seed, 1, 1);
  std::size_t strangers = 0;
  std::size_t repeated = 0;
  for (std::uint32_t index = 0; index < submaps; ++index) {
    raw.push_back(noise(seed + index, *rc::gen::inRange<std::size_t>(1, 200'000)));
    for (const submap_chunk_t& chunk : cut(index, raw.back())) {
      messages.emplace_back(random.next_u64(), chunk);
      if (random.uniform() < 0.3) {
        messages.emplace_back(random.next_u64(), chunk);
        ++repeated;
      }
      if (random.uniform() < 0.3) {
        submap_chunk_t stranger = chunk;
        stranger.run[0] = static_cast<std::uint8_t>(stranger.run[0] ^ 1);
        messages.emplace_back(random.next_u64(), stranger);
        ++strangers;
      }
    }
  }
  std::sort(messages.begin(), messages.end(), [](const auto& a, const auto& b) { return a.first < b.first; });

  ChunkAssembler chunks = assembler();
  std::vector<int> completed(submaps, 0);
  for (const auto& [key, message] : messages) {
    const std::optional<ChunkAssembler::Complete> complete = chunks.add(encode_message(message));
    if (!complete) continue;
    RC_ASSERT(complete->raw == raw[complete->index]);
    RC_ASSERT(complete->hash == sha256_of(raw[complete->index]).value());
    ++completed[complete->index];
  }
  // A repetition after completion begins anew; only forget_below() can tell it from a sub-map still to come.
  for (const int times : completed) RC_ASSERT(times >= 1);
  RC_ASSERT(chunks.counters().received == messages.size());
  RC_ASSERT(chunks.counters().foreign == strangers);
  RC_ASSERT(chunks.counters().duplicates <= repeated);
  RC_ASSERT(chunks.counters().bad == 0U);
}

RC_GTEST_PROP(SubmapChunks, WithoutOneChunkNothingComes, (std::uint64_t seed)) {
  std::vector<submap_chunk_t> chunks = cut(0, noise(seed, *rc::gen::inRange<std::size_t>(1, 300'000)));
  chunks.erase(chunks.begin() + static_cast<std::ptrdiff_t>(seed % chunks.size()));
  ChunkAssembler collected = assembler();
  for (const submap_chunk_t& chunk : chunks) RC_ASSERT(!collected.add(encode_message(chunk)).has_value());
  collected.forget_below(1);
  RC_ASSERT(collected.counters().bytes_used == 0U);
  for (const submap_chunk_t& chunk : chunks) RC_ASSERT(!collected.add(encode_message(chunk)).has_value());
  RC_ASSERT(collected.counters().duplicates == chunks.size());
  RC_ASSERT(collected.counters().bytes_used == 0U);
}

TEST(SubmapChunks, EachFitsADatagram) {
  const std::vector<submap_chunk_t> chunks = cut(0, noise(1, 200'000));
  EXPECT_EQ(chunks.size(), 4U);
  for (const submap_chunk_t& chunk : chunks) EXPECT_LE(encode_message(chunk).size(), kMaxMessageBytes);
  EXPECT_EQ(chunks[3].seq, 3);
}

TEST(SubmapChunks, EveryFlippedByteIsNoticedOrLeavesTheDataAsItWas) {
  const std::vector<std::byte> raw = noise(2, 50);
  const std::vector<std::byte> message = encode_message(cut(0, raw).front());
  for (std::size_t i = 0; i < message.size(); ++i) {
    std::vector<std::byte> damaged = message;
    damaged[i] ^= std::byte{0x40};
    const std::optional<ChunkAssembler::Complete> complete = assembler().add(damaged);
    if (complete) EXPECT_EQ(complete->raw, raw) << "byte " << i;
  }
}

TEST(SubmapChunks, SizesThatLieAreRefused) {
  const submap_chunk_t good = cut(0, noise(3, 130'000)).front();
  ASSERT_TRUE(decode_submap_chunk(encode_message(good)).has_value());
  const auto refused = [&good](auto change) {
    submap_chunk_t chunk = good;
    change(chunk);
    return !decode_submap_chunk(encode_message(chunk)).has_value();
  };
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.raw_bytes = static_cast<std::int32_t>(kMaxEncodedSubmapBytes) + 1; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.raw_bytes = -1; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.compressed_bytes = 1 << 30; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.compressed_bytes = 0; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.chunks = 1 << 30; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.chunks = -3; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.chunk = 3; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.chunk = -1; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.submap = -1; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.crc32 ^= 1; }));
  EXPECT_TRUE(refused([](submap_chunk_t& c) { c.data[7] = static_cast<std::uint8_t>(c.data[7] ^ 1); }));
}

// Highly compressible data that claims to be small: the announced size caps what is decompressed.
TEST(SubmapChunks, DecompressionStopsAtTheAnnouncedSize) {
  const std::vector<std::byte> zeros(std::size_t{8} << 20);
  std::vector<submap_chunk_t> chunks = cut(0, zeros);
  ASSERT_EQ(chunks.size(), 1U);
  chunks[0].raw_bytes = 100;
  ChunkAssembler collected = assembler();
  EXPECT_FALSE(collected.add(encode_message(chunks[0])).has_value());
  EXPECT_EQ(collected.counters().damaged, 1U);
}

TEST(SubmapChunks, WrongHashIsNeverComplete) {
  std::vector<submap_chunk_t> chunks = cut(0, noise(4, 1000));
  chunks[0].sha256[0] = static_cast<std::uint8_t>(chunks[0].sha256[0] ^ 1);
  ChunkAssembler collected = assembler();
  EXPECT_FALSE(collected.add(encode_message(chunks[0])).has_value());
  EXPECT_EQ(collected.counters().damaged, 1U);
  EXPECT_EQ(collected.counters().bytes_used, 0U);
}

TEST(SubmapChunks, UnknownHashIsNotKept) {
  ChunkAssembler collected(
      kCart, kRun, [](std::uint32_t index, const Sha256&) { return index == 1; }, 1 << 20);
  EXPECT_FALSE(collected.add(encode_message(cut(0, noise(5, 100'000)).front())).has_value());
  EXPECT_EQ(collected.counters().forged, 1U);
  EXPECT_EQ(collected.counters().bytes_used, 0U);
}

TEST(SubmapChunks, BudgetHoldsAndTheOldestGivesWay) {
  ChunkAssembler collected = assembler(150'000);
  std::vector<std::vector<std::byte>> raw;
  for (std::uint32_t index = 0; index < 10; ++index) {
    raw.push_back(noise(index, 100'000));
    EXPECT_FALSE(collected.add(encode_message(cut(index, raw.back()).front())).has_value());
    EXPECT_LE(collected.counters().bytes_used, 150'000U);
  }
  EXPECT_EQ(collected.counters().evicted, 8U);
  EXPECT_LE(collected.counters().bytes_peak, 150'000U);
  const auto complete = collected.add(encode_message(cut(9, raw[9]).back()));  // 8 gives way, 9 is whole
  ASSERT_TRUE(complete.has_value());
  EXPECT_EQ(complete->raw, raw[9]);
}

TEST(SubmapChunks, MoreThanAnySubmapIsNotSent) {
  const std::vector<std::byte> huge(kMaxEncodedSubmapBytes + 1);
  EXPECT_EQ(chunk_submap({kCart, kRun, 0}, 0, huge, {}, 0).error().code(), StatusCode::kExhausted);
  EXPECT_FALSE(chunk_submap({kCart, kRun, 0}, 0, {}, {}, 0).has_value());
}

TEST(SubmapChunks, TheLargestSubmapComesThrough) {
  const std::vector<std::byte> largest = noise(6, kMaxEncodedSubmapBytes);
  ChunkAssembler collected = assembler(std::size_t{20} << 20);
  std::optional<ChunkAssembler::Complete> complete;
  for (const submap_chunk_t& chunk : cut(0, largest)) complete = collected.add(encode_message(chunk));
  ASSERT_TRUE(complete.has_value());
  EXPECT_EQ(complete->raw, largest);
}

}  // namespace
}  // namespace submapd
