#include "slam/submap/submap_archive.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <thread>
#include <vector>

#include "slam/submap/submap_codec.hpp"
#include "tests/support/random_submap.hpp"
#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

class SubmapArchiveTest : public testing::Test {
 protected:
  static FinishedSubmap submap(std::uint32_t index) {
    return random_submap(11, {Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), index});
  }
  std::unique_ptr<SubmapArchive> open(std::size_t limit) {
    Expected<std::unique_ptr<SubmapArchive>> archive = SubmapArchive::open(folder_.path() / "submaps", limit);
    EXPECT_TRUE(archive.has_value());
    return std::move(*archive);
  }

  TemporaryFolder folder_;
};

TEST_F(SubmapArchiveTest, SavedIsLoadedByAnotherArchiveOfTheFolder) {
  const Expected<Sha256> hash = open(0)->save(submap(3));
  ASSERT_TRUE(hash.has_value());
  EXPECT_EQ(*hash, sha256_of(encode_submap(submap(3))).value());
  const auto archive = open(1 << 20);
  EXPECT_EQ(archive->path_of(3).filename(), "000003.submap");
  const auto loaded = archive->load(3);
  ASSERT_TRUE(loaded.has_value());
  EXPECT_EQ(encode_submap(**loaded), encode_submap(submap(3)));
  EXPECT_EQ(archive->load(4).error().code(), StatusCode::kNotFound);
}

TEST_F(SubmapArchiveTest, WhatCouldNotBeLoadedIsNotSaved) {
  const auto archive = open(0);
  FinishedSubmap bad = submap(0);
  bad.keyframes.clear();
  EXPECT_EQ(archive->save(bad).error().code(), StatusCode::kInvalidArgument);
  EXPECT_FALSE(std::filesystem::exists(archive->path_of(0)));
}

TEST_F(SubmapArchiveTest, CacheStaysInsideItsBudgetAndDropsTheLeastRecent) {
  const auto writer = open(0);
  for (std::uint32_t i = 0; i < 4; ++i) ASSERT_TRUE(writer->save(submap(i)).has_value());
  const std::size_t one = memory_bytes(**writer->load(0));
  const auto archive = open(2 * one + one / 2);  // room for two
  const auto files_read_by = [&](std::uint32_t index) {
    const std::uint64_t before = archive->files_read();
    EXPECT_TRUE(archive->load(index).has_value());
    EXPECT_LE(archive->cache_bytes().used, archive->cache_bytes().limit);
    return archive->files_read() - before;
  };
  EXPECT_EQ(files_read_by(0), 1U);
  EXPECT_EQ(files_read_by(1), 1U);
  EXPECT_EQ(files_read_by(0), 0U);  // 1 is now the least recent
  EXPECT_EQ(files_read_by(2), 1U);  // drops it
  EXPECT_EQ(files_read_by(0), 0U);
  EXPECT_EQ(files_read_by(1), 1U);
  EXPECT_EQ(archive->cache_bytes().used, 2 * one);
  EXPECT_EQ(archive->cache_bytes().peak, 2 * one);
}

TEST_F(SubmapArchiveTest, ReleasedItReadsAgain) {
  const auto archive = open(1 << 20);
  ASSERT_TRUE(archive->save(submap(0)).has_value());
  ASSERT_TRUE(archive->load(0).has_value());
  EXPECT_GT(archive->cache_bytes().used, 0U);
  archive->release();
  EXPECT_EQ(archive->cache_bytes().used, 0U);
  EXPECT_TRUE(archive->load(0).has_value());
  EXPECT_EQ(archive->files_read(), 2U);
}

TEST_F(SubmapArchiveTest, LargerThanTheBudgetIsLoadedButNotKept) {
  const auto archive = open(100);
  ASSERT_TRUE(archive->save(submap(0)).has_value());
  ASSERT_TRUE(archive->load(0).has_value());
  ASSERT_TRUE(archive->load(0).has_value());
  EXPECT_EQ(archive->files_read(), 2U);
  EXPECT_EQ(archive->cache_bytes().peak, 0U);
}

TEST_F(SubmapArchiveTest, DroppedFromTheCacheStaysAliveForItsHolder) {
  const auto archive = open(memory_bytes(submap(0)) + 200);
  for (std::uint32_t i = 0; i < 2; ++i) ASSERT_TRUE(archive->save(submap(i)).has_value());
  const auto held = archive->load(0);
  ASSERT_TRUE(archive->load(1).has_value());
  EXPECT_EQ(encode_submap(**held), encode_submap(submap(0)));
}

// The folder could not be synced after the file had its name: the next try finds the same file there.
TEST_F(SubmapArchiveTest, TheSameSubmapIsTakenAgainAnotherIsNot) {
  const auto archive = open(1 << 20);
  const auto first = archive->save(submap(0));
  const auto second = archive->save(submap(0));
  ASSERT_TRUE(first.has_value() && second.has_value());
  EXPECT_EQ(*first, *second);
  FinishedSubmap other = submap(0);
  other.odom_from_submap.x += 1.0;
  EXPECT_EQ(archive->save(other).error().code(), StatusCode::kInvalidArgument);
}

// Power went in the middle: of the file's name there is nothing, only the temporary; of a torn copy, an error.
TEST_F(SubmapArchiveTest, TornWritesAreNeverLoaded) {
  const auto archive = open(1 << 20);
  ASSERT_TRUE(archive->save(submap(0)).has_value());
  const auto size = std::filesystem::file_size(archive->path_of(0));
  for (const std::uintmax_t left : {std::uintmax_t{0}, std::uintmax_t{10}, size / 2, size - 1}) {
    std::filesystem::copy_file(archive->path_of(0), archive->path_of(1),
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(archive->path_of(1), left);
    const auto loaded = archive->load(1);
    ASSERT_FALSE(loaded.has_value());
    EXPECT_EQ(loaded.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(loaded.error().message(), testing::HasSubstr("000001.submap"));
  }
}

TEST_F(SubmapArchiveTest, FileUnderAnotherNumberIsRefused) {
  const auto archive = open(1 << 20);
  ASSERT_TRUE(archive->save(submap(0)).has_value());
  std::filesystem::copy_file(archive->path_of(0), archive->path_of(5));
  EXPECT_EQ(archive->load(5).error().code(), StatusCode::kCorrupt);
}

TEST_F(SubmapArchiveTest, HugeFileIsRefusedUnread) {
  const auto archive = open(1 << 20);
  std::ofstream(archive->path_of(0)).put('x');
  std::filesystem::resize_file(archive->path_of(0), kMaxEncodedSubmapBytes + 1);
  EXPECT_EQ(archive->load(0).error().code(), StatusCode::kCorrupt);
  EXPECT_EQ(archive->files_read(), 0U);
}

TEST_F(SubmapArchiveTest, OneThreadSavesWhileAnotherLoads) {
  const auto archive = open(1 << 20);
  ASSERT_TRUE(archive->save(submap(0)).has_value());
  std::thread saver([&] {
    for (std::uint32_t i = 1; i < 20; ++i) EXPECT_TRUE(archive->save(submap(i)).has_value());
  });
  for (std::uint32_t i = 0; i < 20; ++i) EXPECT_TRUE(archive->load(0).has_value());
  saver.join();
  EXPECT_TRUE(archive->load(19).has_value());
}

TEST_F(SubmapArchiveTest, FolderThatCannotBeIsAnError) {
  std::ofstream(folder_.path() / "file").put('x');
  EXPECT_EQ(SubmapArchive::open(folder_.path() / "file" / "submaps", 0).error().code(), StatusCode::kIo);
}

}  // namespace
}  // namespace submapd
