// What the recorder writes is an LCM log: our reader gets every scan back, over several files.
#include "daemon/raw_log.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <vector>

#include "proto/scan_conversion.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/log/raw_series.hpp"

namespace submapd {
namespace {

Scan scan_number(std::uint64_t index) {
  Scan scan;
  scan.index = index;
  scan.stamp_us = 1'000'000 + static_cast<std::int64_t>(index) * 25'000;
  scan.ranges_mm.assign(1081, static_cast<std::uint16_t>(1000 + index));
  return scan;
}

const ScanOrigin kOrigin{Uuid::from_seed(4, 1), Uuid::from_seed(4, 2), 17, 18};

std::vector<std::uint64_t> indices_in(const std::filesystem::path& path, std::uint64_t damaged = 0) {
  std::vector<std::uint64_t> indices;
  auto reader = tools::open_log(path.string(), [](std::string_view channel, std::span<const std::byte> data) {
    EXPECT_EQ(channel, "CART_SCAN_H");
    Expected<ScanMessage> message = decode_scan(data);
    EXPECT_TRUE(message.has_value());
    EXPECT_EQ(message->origin, kOrigin);
    return Expected<std::optional<Scan>>(message->scan);
  });
  EXPECT_TRUE(reader.has_value()) << path;
  while (reader) {
    const auto scan = (*reader)->next();
    if (!scan || !*scan) break;
    EXPECT_EQ((*scan)->ranges_mm, scan_number((*scan)->index).ranges_mm);
    indices.push_back((*scan)->index);
  }
  EXPECT_EQ((*reader)->summary().skipped_records, damaged);
  return indices;
}

TEST(RawLogTest, FilesRotateAndHoldEveryEvent) {
  const TemporaryFolder folder;
  std::vector<std::uint64_t> written;
  {
    RawLog log(folder.path(), 10'000);  // some four scans
    for (std::uint64_t i = 0; i < 11; ++i) {
      const Scan scan = scan_number(i);
      ASSERT_TRUE(log.write("CART_SCAN_H", scan.stamp_us, encode_scan(scan, kOrigin)).ok());
      written.push_back(i);
    }
    ASSERT_TRUE(log.sync().ok());
    std::uintmax_t bytes = 0;
    for (const auto& file : std::filesystem::directory_iterator(folder.path())) bytes += file.file_size();
    EXPECT_EQ(log.bytes(), bytes);
  }
  std::vector<std::uint64_t> read;
  for (const std::filesystem::path& file : tools::raw_files_in(folder.path())) {
    std::filesystem::copy_file(file, folder.path() / "one.lcmlog", std::filesystem::copy_options::overwrite_existing);
    const std::vector<std::uint64_t> more = indices_in(folder.path() / "one.lcmlog");
    EXPECT_FALSE(more.empty());
    read.insert(read.end(), more.begin(), more.end());
  }
  EXPECT_EQ(read, written);
  // The folder and the first file mean all of them, also when one was cut off and the next says more.
  EXPECT_EQ(indices_in(folder.path()), written);
  EXPECT_EQ(indices_in(folder.path() / "raw-0000.lcmlog"), written);
  const std::filesystem::path second = folder.path() / "raw-0001.lcmlog";
  const std::vector<std::uint64_t> of_second = indices_in(second);
  std::filesystem::resize_file(second, std::filesystem::file_size(second) - 100);
  std::erase(written, of_second.back());
  EXPECT_EQ(indices_in(folder.path(), 1), written);
  {
    RawLog log(folder.path(), 10'000, tools::next_raw_number(tools::raw_files_in(folder.path())));
    const Scan scan = scan_number(20);
    ASSERT_TRUE(log.write("CART_SCAN_H", scan.stamp_us, encode_scan(scan, kOrigin)).ok());
  }
  written.push_back(20);
  EXPECT_EQ(indices_in(folder.path(), 1), written);
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "raw-0003.lcmlog"));
}

TEST(RawLogTest, AMissingFolderIsToldEachTime) {
  const TemporaryFolder folder;
  RawLog log(folder.path() / "gone", 1000);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(log.write("C", 0, {}).code(), StatusCode::kIo);
  std::filesystem::create_directory(folder.path() / "gone");
  EXPECT_TRUE(log.write("C", 0, {}).ok()) << "and tried again";
}

}  // namespace
}  // namespace submapd
