#include "tools/replay/chunk_reader.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <utility>
#include <vector>

namespace submapd::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class ScansOf : public LogReader {
 public:
  explicit ScansOf(std::vector<std::int64_t> stamps_s) : stamps_s_(std::move(stamps_s)) {}
  Expected<std::optional<Scan>> next() override {
    if (next_ == stamps_s_.size()) return std::optional<Scan>();
    Scan scan;
    scan.index = next_;
    scan.stamp_us = stamps_s_[next_++] * 1'000'000;
    return std::optional<Scan>(scan);
  }
  [[nodiscard]] const LogSummary& summary() const override { return summary_; }
  [[nodiscard]] double progress() const override { return 0.0; }

 private:
  std::vector<std::int64_t> stamps_s_;
  std::size_t next_ = 0;
  LogSummary summary_;
};

constexpr ChunkOptions kTenAndThree{.length_s = 10.0, .seam_s = 3.0, .seam_scans = 100};

ChunkReader reader_of(std::vector<std::int64_t> stamps_s, const ChunkOptions& options = kTenAndThree) {
  return {std::make_unique<ScansOf>(std::move(stamps_s)), options};
}

std::vector<std::int64_t> seconds(std::int64_t first, std::int64_t end) {
  std::vector<std::int64_t> stamps;
  for (std::int64_t s = first; s < end; ++s) stamps.push_back(s);
  return stamps;
}

std::vector<std::uint64_t> rest_of(ChunkReader& reader) {
  std::vector<std::uint64_t> indices;
  for (;;) {
    const auto scan = reader.next();
    if (!scan || !scan->has_value()) return indices;
    indices.push_back((*scan)->index);
  }
}

std::vector<std::uint64_t> seam_of(const ChunkReader& reader) {
  std::vector<std::uint64_t> indices;
  for (std::size_t k = 0; k < reader.seam_scans(); ++k) indices.push_back(reader.ahead()[k].index);
  return indices;
}

TEST(ChunkReader, ASeamIsTheBeginningOfTheNextChunk) {
  ChunkReader reader = reader_of(seconds(100, 125));
  ASSERT_TRUE(reader.enter(0).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
  EXPECT_THAT(seam_of(reader), ElementsAre(10, 11, 12));
  ASSERT_TRUE(reader.enter(1).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(10, 11, 12, 13, 14, 15, 16, 17, 18, 19));
  EXPECT_THAT(seam_of(reader), ElementsAre(20, 21, 22));
  ASSERT_TRUE(reader.enter(2).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(20, 21, 22, 23, 24));
  EXPECT_THAT(seam_of(reader), IsEmpty());
  EXPECT_FALSE(reader.enter(3).value());
}

// What makes any number of workers cut alike.
TEST(ChunkReader, ChunksAreTheSameForWhoSkipsSome) {
  ChunkReader one = reader_of(seconds(0, 47));
  ChunkReader other = reader_of(seconds(0, 47));
  for (const std::uint64_t chunk : {0U, 1U, 2U, 3U}) {
    ASSERT_TRUE(one.enter(chunk).value());
    const auto scans = rest_of(one);
    if (chunk % 2 == 0) continue;
    ASSERT_TRUE(other.enter(chunk).value());
    EXPECT_EQ(rest_of(other), scans);
    EXPECT_EQ(seam_of(other), seam_of(one));
  }
}

TEST(ChunkReader, WhatIsNoLongerThanASeamIsTheEndOfTheChunkBefore) {
  ChunkReader reader = reader_of(seconds(0, 13));
  ASSERT_TRUE(reader.enter(0).value());
  EXPECT_EQ(rest_of(reader).size(), 13U);
  EXPECT_THAT(seam_of(reader), IsEmpty());
  EXPECT_FALSE(reader.enter(1).value());
}

TEST(ChunkReader, AfterAGapAChunkBeginsWithTheNextScan) {
  ChunkReader reader = reader_of({0, 1, 2, 500, 501, 900, 901, 905});
  ASSERT_TRUE(reader.enter(0).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(0, 1, 2));
  EXPECT_THAT(seam_of(reader), ElementsAre(3, 4));
  ASSERT_TRUE(reader.enter(1).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(3, 4));
  EXPECT_THAT(seam_of(reader), ElementsAre(5, 6));
  ASSERT_TRUE(reader.enter(2).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(5, 6, 7));
  EXPECT_FALSE(reader.enter(3).value());
}

TEST(ChunkReader, ASeamOfStampsThatStandStillEnds) {
  ChunkOptions options = kTenAndThree;
  options.seam_scans = 4;
  ChunkReader reader = reader_of({0, 10, 10, 10, 10, 10, 10, 10}, options);
  ASSERT_TRUE(reader.enter(0).value());
  EXPECT_THAT(rest_of(reader), ElementsAre(0));
  EXPECT_THAT(seam_of(reader), ElementsAre(1, 2, 3, 4));
}

TEST(ChunkReader, WildStampsEnd) {
  const std::int64_t far_s = 9'000'000'000'000;
  ChunkReader reader = reader_of({-far_s, far_s, -far_s, far_s, far_s, far_s});
  std::size_t scans = 0;
  for (std::uint64_t chunk = 0; reader.enter(chunk).value(); ++chunk) scans += rest_of(reader).size();
  EXPECT_EQ(scans, 6U);
}

}  // namespace
}  // namespace submapd::tools
