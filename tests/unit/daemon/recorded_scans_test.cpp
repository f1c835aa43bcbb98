// The vertical scanner's scans out of a run's raw log, with their echo strengths, while the log is being written.
#include "daemon/recorded_scans.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "daemon/raw_log.hpp"
#include "proto/scan_conversion.hpp"
#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

const Channels kChannels;
const ScanOrigin kOrigin{Uuid::from_seed(4, 1), Uuid::from_seed(4, 2), 17, 18};

void write_scan(RawLog& log, const std::string& channel, std::uint64_t index, std::size_t beams) {
  Scan scan;
  scan.index = index;
  scan.stamp_us = static_cast<std::int64_t>(index) * 25'000;
  scan.ranges_mm.assign(beams, static_cast<std::uint16_t>(1000 + index));
  ASSERT_TRUE(log.write(channel, scan.stamp_us, encode_scan(scan, kOrigin)).ok());
}

void write_intensities(RawLog& log, std::uint64_t index, std::uint16_t value) {
  ASSERT_TRUE(
      log.write(kChannels.intensity_v, 0, encode_intensities({0, index, {value, value, 65'535}}, kOrigin)).ok());
}

std::vector<CloudScan> all_of(const std::filesystem::path& run) {
  std::vector<CloudScan> all;
  const auto scans = open_recorded_scans(run, kChannels, driver::SensorRole::kVertical);
  EXPECT_TRUE(scans.has_value());
  while (scans) {
    Expected<std::optional<CloudScan>> scan = (*scans)->next();
    EXPECT_TRUE(scan.has_value());
    if (!scan || !*scan) break;
    all.push_back(std::move(**scan));
  }
  return all;
}

TEST(RecordedScansTest, OfAllFilesInOrderWithTheirOwnIntensities) {
  const TemporaryFolder folder;
  {
    RawLog log(folder.path(), 4'000);  // a few scans a file
    for (std::uint64_t i = 0; i < 40; ++i) {
      write_scan(log, kChannels.scan_h, i, 100);
      if (i % 5 == 1) write_intensities(log, i + 1000, 7);  // its scan was not written
      if (i % 2 == 0) write_intensities(log, i, static_cast<std::uint16_t>(60'000 + i));
      write_scan(log, kChannels.scan_v, i, 3);
    }
  }
  EXPECT_GT(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 2);
  const std::vector<CloudScan> scans = all_of(folder.path());
  ASSERT_EQ(scans.size(), 40U);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    EXPECT_EQ(scans[i].scan.index, i);
    EXPECT_EQ(scans[i].scan.ranges_mm[0], 1000 + i);
    const auto value = static_cast<std::uint16_t>(60'000 + i);
    EXPECT_EQ(scans[i].intensities,
              i % 2 == 0 ? (std::vector<std::uint16_t>{value, value, 65'535}) : std::vector<std::uint16_t>{});
  }
}

TEST(RecordedScansTest, AHalfWrittenEventAndFilesWithoutScansAreLeftOut) {
  for (const std::uintmax_t missing : {1U, 2U, 3U, 10U, 500U}) {
    const TemporaryFolder folder;
    EXPECT_TRUE(all_of(folder.path()).empty());
    {
      RawLog log(folder.path(), 1'000'000);
      for (std::uint64_t i = 0; i < 5; ++i) write_scan(log, kChannels.scan_v, i, 500);
    }
    const std::filesystem::path torn = folder.path() / "raw-0000.lcmlog";
    std::filesystem::resize_file(torn, std::filesystem::file_size(torn) - missing);
    EXPECT_EQ(all_of(folder.path()).size(), 4U) << missing;
    {
      RawLog log(folder.path(), 1'000'000, 1);
      for (std::uint64_t i = 5; i < 7; ++i) write_scan(log, kChannels.scan_v, i, 500);
    }
    std::ofstream(folder.path() / "raw-0002.lcmlog") << "not yet a log";
    std::vector<std::uint64_t> indices;
    for (const CloudScan& scan : all_of(folder.path())) indices.push_back(scan.scan.index);
    EXPECT_EQ(indices, (std::vector<std::uint64_t>{0, 1, 2, 3, 5, 6})) << missing << " bytes of the fifth are missing";
    EXPECT_EQ(open_recorded_scans(folder.path() / "none", kChannels, driver::SensorRole::kVertical).error().code(),
              StatusCode::kIo);
  }
}

}  // namespace
}  // namespace submapd
