// Numbers and stamps of a run's scans: gaps show, a clock that begins anew goes on, stamps always grow.
#include "daemon/scan_stamper.hpp"

#include <gtest/gtest.h>

namespace submapd {
namespace {

constexpr std::int64_t kOffset_ns = 1'000'000'000'000;
constexpr std::int64_t kTurn_ns = 25'000'000;

driver::DeviceScan measured(std::int64_t mono_ns, std::uint32_t epoch, std::uint64_t turn) {
  driver::DeviceScan scan;
  scan.first_beam_mono_ns = mono_ns;
  scan.epoch = epoch;
  scan.index = turn;
  scan.beams = 1081;
  scan.ranges_mm.fill(static_cast<std::uint16_t>(turn + 100));
  return scan;
}

class ScanStamperTest : public testing::Test {
 protected:
  ScanStamper stamper{RunClock(kOffset_ns), utm30lx_geometry()};
};

TEST_F(ScanStamperTest, ValuesAndWallClockAreTaken) {
  const Scan& scan = stamper.stamp(measured(5'000'999, 1, 40));
  EXPECT_EQ(scan.index, 0U);
  EXPECT_EQ(scan.stamp_us, 1'000'005'000);
  EXPECT_EQ(scan.ranges_mm, std::vector<std::uint16_t>(1081, 140));
  EXPECT_DOUBLE_EQ(scan.geometry.sweep_s, 0.01875);
  EXPECT_FALSE(scan.odometry.has_value());
}

TEST_F(ScanStamperTest, GapsOfTheRotorAreGapsInTheNumbers) {
  stamper.stamp(measured(0, 1, 7));
  EXPECT_EQ(stamper.stamp(measured(kTurn_ns, 1, 8)).index, 1U);
  EXPECT_EQ(stamper.stamp(measured(4 * kTurn_ns, 1, 11)).index, 4U);
  EXPECT_EQ(stamper.missing(), 2U);
}

TEST_F(ScanStamperTest, ANewEpochIsBridgedByTime) {
  stamper.stamp(measured(0, 1, 7));
  EXPECT_EQ(stamper.stamp(measured(40 * kTurn_ns + 3'000'000, 2, 0)).index, 40U);
  EXPECT_EQ(stamper.stamp(measured(41 * kTurn_ns + 3'000'000, 2, 1)).index, 41U);
  EXPECT_EQ(stamper.stamp(measured(41 * kTurn_ns, 3, 0)).index, 42U) << "never the same number twice";
}

TEST_F(ScanStamperTest, StampsGrowWhateverTheClockSays) {
  stamper.stamp(measured(10 * kTurn_ns, 1, 7));
  const std::int64_t before = stamper.stamp(measured(11 * kTurn_ns, 1, 8)).stamp_us;
  EXPECT_EQ(stamper.stamp(measured(9 * kTurn_ns, 1, 9)).stamp_us, before + 1);
  EXPECT_EQ(stamper.stamp(measured(12 * kTurn_ns, 1, 10)).stamp_us, before + kTurn_ns / 1000);
}

}  // namespace
}  // namespace submapd
