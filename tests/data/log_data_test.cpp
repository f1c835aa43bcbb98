// Every recorded log reads whole: the published number of scans, nothing skipped.
#include <gtest/gtest.h>

#include "tests/data/data_folder.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::tools::test {
namespace {

struct RecordedLog {
  const char* path;
  std::uint64_t scans;
  std::uint64_t odometry_records;
};

class RecordedLogTest : public ::submapd::test::DataTest {};

TEST_F(RecordedLogTest, ReadsWithNothingSkipped) {
  const RecordedLog logs[] = {
      {"intel/intel.clf.xz", 5438, 26915},
      {"mit-csail/mit-csail.clf.xz", 1223, 1988},
      {"hokuyo/exp1.clf.xz", 756, 756},
      {"hokuyo/exp2.clf.xz", 641, 641},
      {"hokuyo/ccny_handheld.clf.xz", 360, 0},
      {"hokuyo/utm30lx_trees.clf.xz", 190, 0},
      {"carmen-sparse/acapulco-corrected.log.gz", 861, 12142},
      {"carmen-sparse/aces-corrected.log.gz", 440, 7814},
      {"carmen-sparse/edmonton-corrected.log.gz", 340, 6351},
      {"carmen-sparse/fhw-corrected.log.gz", 488, 13935},
      {"carmen-sparse/freiburg-101-corrected.log.gz", 292, 4569},
      {"carmen-sparse/freiburg-campus-corrected.log.gz", 2008, 17691},
      {"carmen-sparse/seattle-corrected.log.gz", 241, 19311},
  };
  for (const auto& log : logs) {
    SCOPED_TRACE(log.path);
    auto reader = open_log(data(log.path).string(), nullptr);
    ASSERT_TRUE(reader.has_value()) << reader.error().message();
    std::uint64_t scans = 0;
    for (;;) {
      const auto scan = (*reader)->next();
      ASSERT_TRUE(scan.has_value()) << scan.error().message();
      if (!scan->has_value()) break;
      EXPECT_EQ((*scan)->index, scans++);
      EXPECT_TRUE((*scan)->odometry.has_value());
      EXPECT_EQ((*scan)->geometry.base_from_sensor, Pose2{}) << "both poses are the same in these logs";
    }
    const LogSummary& summary = (*reader)->summary();
    EXPECT_EQ(scans, log.scans);
    EXPECT_EQ(summary.scans, log.scans);
    EXPECT_EQ(summary.odometry_records, log.odometry_records);
    EXPECT_EQ(summary.skipped_records, 0U) << (summary.problems.empty() ? "" : summary.problems.front());
    EXPECT_FALSE(summary.unreadable_tail);
  }
}

TEST_F(RecordedLogTest, FirstIntelScanIsAsPrinted) {
  auto reader = open_log(data("intel/intel.clf.xz").string(), nullptr);
  ASSERT_TRUE(reader.has_value()) << reader.error().message();
  const auto scan = (*reader)->next();
  ASSERT_TRUE(scan.has_value() && scan->has_value());
  ASSERT_EQ((*scan)->ranges_mm.size(), 180U);
  EXPECT_EQ((*scan)->ranges_mm[0], 1070);
  EXPECT_EQ((*scan)->ranges_mm[2], 1080);
}

}  // namespace
}  // namespace submapd::tools::test
