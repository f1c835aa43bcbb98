// The USB transport through the real libusb: streams, two scanners, and everything a bus does to a line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

#include "tests/process/usb_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::HasSubstr;

constexpr std::size_t kScanBytes = 3372;

SimSensorOptions with_script(const char* script) {
  SimSensorOptions options;
  options.script = {*parse_sim_fault(script)};
  return options;
}

std::size_t scans_in(const std::string& bytes) {
  return occurrences(bytes, "\n99b\n");
}

TEST(UsbTransport, OneScannerStreamsWithoutALostByte) {
  UsbRig rig;
  rig.plug("1-1");
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.records.empty() && scans_in(rig.records[0]->bytes) >= 100; }));
  const std::lock_guard lock(rig.mutex);
  const LineRecord& record = *rig.records[0];
  EXPECT_EQ(record.port.path, "1-1");
  const std::size_t first = record.bytes.find("MD0000108001000\n99b");
  ASSERT_NE(first, std::string::npos);
  // Every scan is exactly as long as the one before, and the offsets leave no gap.
  for (std::size_t scan = 0; scan < 99; ++scan) {
    ASSERT_EQ(record.bytes.compare(first + scan * kScanBytes, 19, "MD0000108001000\n99b"), 0) << scan;
  }
  for (std::size_t i = 1; i < record.stamps.size(); ++i) {
    ASSERT_GT(record.stamps[i].first, record.stamps[i - 1].first);
    ASSERT_LE(record.stamps[i].first - record.stamps[i - 1].first, UsbOptions{}.transfer_bytes);
    ASSERT_GE(record.stamps[i].second, record.stamps[i - 1].second);
  }
  EXPECT_TRUE(record.faults.empty());
}

TEST(UsbTransport, TwoScannersStreamAtOnceAndKeepTheirNames) {
  UsbRig rig;
  SimSensorOptions second;
  second.serial = "H0900001";
  rig.plug("1-1");
  rig.plug("1-2", second);
  rig.start();
  ASSERT_TRUE(rig.wait([&] {
    return rig.records.size() == 2 && scans_in(rig.records[0]->bytes) >= 60 && scans_in(rig.records[1]->bytes) >= 60;
  }));
  const std::lock_guard lock(rig.mutex);
  // What is plugged in already is found in no particular order.
  EXPECT_THAT((std::array{rig.records[0]->port.path, rig.records[1]->port.path}),
              testing::UnorderedElementsAre("1-1", "1-2"));
  EXPECT_EQ(rig.records[0]->opens + rig.records[1]->opens, 2);
}

TEST(UsbTransport, EndpointsComeFromTheDescriptors) {
  UsbRig rig;
  tools::CdcLayout layout;
  layout.bulk_in = 0x85;
  layout.bulk_out = 0x06;
  layout.interrupt_in = 0x84;
  layout.control_interface = 1;
  layout.data_interface = 0;
  layout.stalls_line_coding = true;  // which is no error
  rig.plug("1-1", {}, layout);
  rig.start();
  EXPECT_TRUE(rig.wait([&] { return !rig.records.empty() && scans_in(rig.records[0]->bytes) >= 5; }));
}

TEST(UsbTransport, ADeviceWithoutASerialLineIsSaidToBeNone) {
  UsbRig rig;
  tools::CdcLayout layout;
  layout.is_serial = false;
  rig.plug("1-1", {}, layout);
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.errors.empty(); }));
  EXPECT_THAT(rig.errors[0], HasSubstr("not a scanner"));
}

TEST(UsbTransport, AnotherVendorsDeviceIsLeftAlone) {
  UsbRig rig;
  tools::CdcLayout layout;
  layout.product_id = 0x0001;
  rig.plug("1-1", {}, layout);
  rig.plug("1-2");
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.records.empty() && rig.records[0]->opens == 1; }));
  const std::lock_guard lock(rig.mutex);
  EXPECT_EQ(rig.records.size(), 1U);
  EXPECT_EQ(rig.records[0]->port.path, "1-2");
}

TEST(UsbTransport, AStallIsClearedAndTheStreamGoesOn) {
  UsbRig rig;
  rig.plug("1-1", with_script("stall@0.5"));
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.records.empty() && scans_in(rig.records[0]->bytes) >= 60; }));
  rig.stop();
  const std::lock_guard lock(rig.mutex);
  EXPECT_THAT(rig.records[0]->faults, testing::ElementsAre(LinkFault::kStall));
  ASSERT_EQ(rig.counters.size(), 1U);
  EXPECT_EQ(rig.counters[0].stalls, 1U);
}

TEST(UsbTransport, AnOverflowCostsOneTransfer) {
  UsbRig rig;
  rig.plug("1-1", with_script("overflow@0.5"));
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.records.empty() && scans_in(rig.records[0]->bytes) >= 60; }));
  rig.stop();
  const std::lock_guard lock(rig.mutex);
  EXPECT_THAT(rig.records[0]->faults, testing::ElementsAre(LinkFault::kOverflow));
  EXPECT_EQ(rig.counters[0].overflows, 1U);
}

TEST(UsbTransport, UnpluggedInMidTransferItComesBackUnderANewAddress) {
  UsbRig rig;
  rig.plug("1-1", with_script("unplug@0.5:0.3"));
  rig.plug("1-2");
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return rig.records.size() == 3 && scans_in(rig.records[2]->bytes) >= 20; }));
  rig.stop();
  const std::lock_guard lock(rig.mutex);
  const bool first = rig.records[0]->port.path == "1-1";
  const LineRecord& before = *rig.records[first ? 0 : 1];
  const LineRecord& after = *rig.records[2];
  EXPECT_EQ(before.closes, 1);
  EXPECT_EQ(after.port.path, "1-1");
  EXPECT_NE(after.port.address, before.port.address);
  // The other scanner's bytes never paused for longer than a scan or two.
  const LineRecord& other = *rig.records[first ? 1 : 0];
  EXPECT_TRUE(other.faults.empty());
  EXPECT_EQ(other.opens, 1);
}

TEST(UsbTransport, ARefusedOpenIsTriedAgainAndAResetKeepsTheOtherStreaming) {
  UsbRig rig;
  rig.reset_after_ns = 500'000'000;  // of the first to arrive
  rig.plug("1-1");
  rig.plug("1-2");
  rig.start();
  ASSERT_TRUE(rig.wait(
      [&] { return rig.records.size() == 2 && rig.records[0]->opens == 2 && scans_in(rig.records[1]->bytes) >= 60; }));
  const std::lock_guard lock(rig.mutex);
  EXPECT_EQ(rig.records[0]->closes, 1);
  EXPECT_EQ(rig.records[1]->opens, 1);
  EXPECT_EQ(rig.records[1]->closes, 0);
}

TEST(UsbTransport, StopsInTimeWithTransfersUnderWay) {
  UsbRig rig;
  rig.plug("1-1");
  rig.start();
  ASSERT_TRUE(rig.wait([&] { return !rig.records.empty() && rig.records[0]->opens == 1; }));
  rig.stop();
  const std::lock_guard lock(rig.mutex);
  EXPECT_EQ(rig.records[0]->closes, 1);
}

}  // namespace
}  // namespace submapd::driver::test
