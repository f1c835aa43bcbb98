// Scanners through the real libusb, from plugging in to scans in their role, and through every scripted fault.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/process/scanners_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::HasSubstr;

constexpr double kTurn_s = 0.025;

TEST(Scanners, TwoStreamAtOnceEachInItsRole) {
  ScannersRig rig;
  rig.plug(0);
  rig.plug(1);
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 120));
  ASSERT_TRUE(rig.wait_for_scans(1, 120));
  ASSERT_TRUE(rig.wait_for_snapshot([](const std::vector<ScannerInfo>& all) {
    return all.size() == 2 && all[0].role && all[1].role && all[0].status.state == SensorState::kStreaming;
  }));
  for (const ScannerInfo& scanner : rig.scanners->snapshot()) {
    EXPECT_EQ(scanner.role,
              scanner.status.identity.serial == kSerials[0] ? SensorRole::kHorizontal : SensorRole::kVertical);
    EXPECT_EQ(scanner.counters.faults, 0U);
  }
  rig.stop();
  for (const std::size_t index : {0U, 1U}) {
    EXPECT_EQ(rig.verdict(index).false_scans, 0U);
    for (std::size_t i = 1; i < rig.sinks[index].scans.size(); ++i) {
      ASSERT_EQ(rig.sinks[index].scans[i].stamp_ms - rig.sinks[index].scans[i - 1].stamp_ms, 25U);  // none lost
    }
  }
}

TEST(Scanners, WithoutRolesNobodyIsGuessed) {
  ScannersRig rig;
  rig.options.roles = {};
  rig.plug(0);
  rig.plug(1);
  rig.start();
  ASSERT_TRUE(rig.wait_for_snapshot([](const std::vector<ScannerInfo>& all) {
    return all.size() == 2 && all[0].status.state == SensorState::kUnassigned &&
           all[1].status.state == SensorState::kUnassigned;
  }));
  const auto all = rig.scanners->snapshot();
  EXPECT_THAT(all[0].status.words + all[1].status.words, HasSubstr("submapctl sensors --assign H=SERIAL V=SERIAL"));
  rig.stop();
  EXPECT_TRUE(rig.sinks[0].scans.empty());
  EXPECT_TRUE(rig.sinks[1].scans.empty());
}

TEST(Scanners, PortsTellApartWhatSerialsAreNotConfiguredFor) {
  ScannersRig rig;
  rig.options.roles = {RoleRule{"", "1-2"}, RoleRule{"", "1-1"}};
  rig.plug(0);
  rig.plug(1);
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 10));
  ASSERT_TRUE(rig.wait_for_scans(1, 10));
  for (const ScannerInfo& scanner : rig.scanners->snapshot()) {
    EXPECT_EQ(scanner.role, scanner.port.path == "1-2" ? SensorRole::kHorizontal : SensorRole::kVertical);
  }
}

TEST(Scanners, HorizontalAloneStreams) {
  ScannersRig rig;
  rig.options.roles[1] = {};
  rig.plug(0);
  rig.start();
  EXPECT_TRUE(rig.wait_for_scans(0, 40));
}

TEST(Scanners, ASecondScannerWithATakenRoleIsRefused) {
  ScannersRig rig;
  SimSensorOptions twin;
  twin.serial = "H0903971";
  rig.plug(0);
  rig.plug(1, {}, twin);
  rig.start();
  EXPECT_TRUE(rig.wait_for_snapshot([](const std::vector<ScannerInfo>& all) {
    return std::any_of(all.begin(), all.end(), [](const ScannerInfo& scanner) {
      return scanner.status.state == SensorState::kUnassigned &&
             scanner.status.words.find("is taken by") != std::string::npos;
    });
  }));
}

TEST(Scanners, TheClockIsMeasuredBeforeTheFirstStream) {
  ScannersRig rig;
  rig.sinks[0].clock_known = false;
  rig.options.sensor.first_samples = 20;
  rig.plug(0);
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 1));
  const std::lock_guard lock(rig.mutex);
  EXPECT_EQ(rig.sinks[0].samples.size(), 20U);
}

// A pause that ended with the timer's millisecond would ask at the same phase of the sensor's millisecond each time, so
// that its edges are never seen, and would make any USB grid look like one of 1 ms.
TEST(Scanners, TheClockIsAskedAtAnyPhaseOfTheMillisecond) {
  ScannersRig rig;
  rig.sinks[0].clock_known = false;
  rig.options.sensor.first_samples = 60;
  rig.plug(0);
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 1));
  const std::lock_guard lock(rig.mutex);
  const std::vector<TimeSample>& samples = rig.sinks[0].samples;
  ASSERT_EQ(samples.size(), 60U);
  int in_the_middle = 0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const std::int64_t phase_ns = (samples[i].sent_ns - samples[i - 1].received_ns) % 1'000'000;
    in_the_middle += phase_ns > 400'000 && phase_ns < 900'000 ? 1 : 0;
  }
  EXPECT_GT(in_the_middle, 15);
}

struct FaultCase {
  const char* script;
  double longest_gap_s;
};

class ScannersFault : public testing::TestWithParam<FaultCase> {};

// The fault hits scanner 0; scanner 1 never notices.
TEST_P(ScannersFault, CostsNoMoreThanPromisedAndTheOtherNotices) {
  const FaultCase& fault = GetParam();
  ScannersRig rig;
  rig.plug(0, {fault.script});
  rig.plug(1);
  rig.start();
  std::size_t before = 0;
  ASSERT_TRUE(rig.wait([&] {
    before = rig.sinks[0].scans.size();
    return !rig.truth[0].empty() && std::any_of(rig.truth[0].begin(), rig.truth[0].end(),
                                                [](const SimScanTruth& scan) { return scan.faults != 0; });
  })) << "no fault happened";
  ASSERT_TRUE(rig.wait_for_scans(0, before + 20));
  rig.stop();
  RecordProperty("without_scans_ms", static_cast<int>(1e3 * rig.verdict(0).longest_gap_s));
  EXPECT_GT(rig.verdict(0).longest_gap_s, 1.5 * kTurn_s) << "the fault did nothing";
  EXPECT_LT(rig.verdict(0).longest_gap_s, fault.longest_gap_s + 0.5 * kTurn_s);
  EXPECT_EQ(rig.verdict(0).false_scans, 0U);
  EXPECT_EQ(rig.verdict(1).false_scans, 0U);
  for (std::size_t i = 1; i < rig.sinks[1].scans.size(); ++i) {
    ASSERT_EQ(rig.sinks[1].scans[i].stamp_ms - rig.sinks[1].scans[i - 1].stamp_ms, 25U);
  }
}

// The damaged scan only: two turns from the scan before it to the one behind it. Others: the fault and 1 s, with the
// hangs counted from the remedy's turn on the ladder; unplugged: 1.5 s after the replug.
INSTANTIATE_TEST_SUITE_P(Script, ScannersFault,
                         testing::Values(FaultCase{"garbled-sum@1", 2 * kTurn_s},
                                         FaultCase{"bad-character@1", 2 * kTurn_s},
                                         FaultCase{"lost-packet@1", 2 * kTurn_s}, FaultCase{"lost-line@1", 2 * kTurn_s},
                                         FaultCase{"doubled-packet@1", 2 * kTurn_s},
                                         FaultCase{"doubled-line@1", 2 * kTurn_s}, FaultCase{"cut@1", 2 * kTurn_s},
                                         FaultCase{"garbage@1", 2 * kTurn_s}, FaultCase{"skip@1", 2 * kTurn_s},
                                         FaultCase{"overflow@1", 2 * kTurn_s}, FaultCase{"silence@1:0.2", 1.2},
                                         FaultCase{"silence@1:0.7", 1.7}, FaultCase{"silence@1:2", 3.0},
                                         FaultCase{"silence@1:3.2", 4.2}, FaultCase{"hang@1:md", 0.25 + 1.0},
                                         FaultCase{"hang@1:qt", 0.5 + 1.0}, FaultCase{"hang@1:rs", 1.0 + 1.0},
                                         FaultCase{"hang@1:reset", 3.0 + 1.0}, FaultCase{"unplug@1:0.5", 0.5 + 1.5},
                                         FaultCase{"power-cycle@1:0.5", 0.5 + 1.5}, FaultCase{"brown-out@1", 1.0},
                                         FaultCase{"trouble@1", 1.0}),
                         [](const testing::TestParamInfo<FaultCase>& tested) {
                           std::string name = tested.param.script;
                           std::erase_if(name, [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; });
                           return name;
                         });

// A stall breaks off between two transfers and loses nothing.
TEST(Scanners, AStallIsClearedBeforeTheNextScan) {
  ScannersRig rig;
  rig.plug(0, {"stall@1"});
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 80));
  rig.stop();
  EXPECT_LT(rig.verdict(0).longest_gap_s, 2.5 * kTurn_s);
  EXPECT_EQ(rig.verdict(0).false_scans, 0U);
}

TEST(Scanners, RandomFaultsGiveNoFalseScan) {
  ScannersRig rig;
  SimSensorOptions options;
  options.fault_rate = 0.1;
  rig.plug(0, {}, options);
  rig.plug(1, {}, options);
  rig.start();
  ASSERT_TRUE(rig.wait_for_scans(0, 200));
  ASSERT_TRUE(rig.wait_for_scans(1, 200));
  rig.stop();
  EXPECT_EQ(rig.verdict(0).false_scans, 0U);
  EXPECT_EQ(rig.verdict(1).false_scans, 0U);
}

}  // namespace
}  // namespace submapd::driver::test
