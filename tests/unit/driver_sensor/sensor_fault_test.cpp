// Every scripted fault costs the damaged scan only, or scans come again within the promised time.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/driver_sensor/sensor_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::HasSubstr;

constexpr double kTurn_s = 0.025;

std::unique_ptr<SensorRig> streaming_with(const std::vector<std::string>& script, SimSensorOptions options = {}) {
  for (const std::string& fault : script) {
    options.script.push_back(*parse_sim_fault(fault));
  }
  auto rig = std::make_unique<SensorRig>(options);
  rig->run(2.0);
  rig->plug_in();
  EXPECT_TRUE(rig->run_until_streaming(1.0));
  return rig;
}

TEST(SensorFault, DamageCostsTheDamagedScanOnly) {
  for (const char* kind : {"garbled-sum", "bad-character", "lost-packet", "lost-line", "doubled-packet", "doubled-line",
                           "cut", "garbage", "skip"}) {
    const auto rig = streaming_with({std::string(kind) + "@1:1"});
    rig->run(3.0);
    EXPECT_EQ(rig->false_scans(), 0U) << kind;
    EXPECT_GT(rig->longest_gap_s(), 1.5 * kTurn_s) << kind;
    EXPECT_LT(rig->longest_gap_s(), 2.5 * kTurn_s) << kind;
    EXPECT_EQ(rig->sensor.counters().starts_again, 0U) << kind;
    // At the end the last scan may not be there yet.
    EXPECT_NEAR(static_cast<double>(rig->scans.size()), static_cast<double>(rig->truth.size()) - 1.0, 1.0) << kind;
  }
}

TEST(SensorFault, ThreeDamagedScansInARowNeedNoRemedy) {
  const auto rig = streaming_with({"garbled-sum@1:3"});
  rig->run(3.0);
  EXPECT_EQ(rig->damaged, 3);
  EXPECT_EQ(rig->sensor.counters().faults, 3U);
  EXPECT_EQ(rig->sensor.counters().gaps, 1U);
  EXPECT_EQ(rig->sensor.counters().starts_again, 0U);
}

TEST(SensorFault, AStallOrOverflowCostsAtMostOneScan) {
  for (const char* script : {"stall@1", "overflow@1"}) {
    const auto rig = streaming_with({script});
    rig->run(3.0);
    EXPECT_LT(rig->longest_gap_s(), 2.5 * kTurn_s) << script;
    EXPECT_EQ(rig->false_scans(), 0U) << script;
  }
}

// Silence of every length, and hangs that each need another remedy: from the end of the fault to the next scan.
TEST(SensorFault, ScansComeAgainAsSoonAsSilenceEnds) {
  for (const double silence_s : {0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.9, 1.1, 1.7, 2.5, 2.95, 3.3, 5.0, 20.0, 60.0}) {
    const auto rig = streaming_with({"silence@1:" + std::to_string(silence_s)});
    rig->run(silence_s + 4.0);
    EXPECT_LT(rig->longest_gap_s(), silence_s + 1.0) << silence_s;
    EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming) << silence_s;
    EXPECT_EQ(rig->false_scans(), 0U) << silence_s;
  }
}

TEST(SensorFault, EachHangMeetsItsRemedyAndNothingMore) {
  struct Case {
    const char* script;
    double most_s;
    std::uint64_t quits, sensor_resets, usb_resets;
  };
  for (const Case& hang : {Case{"hang@1:md", 0.4, 0, 0, 0}, Case{"hang@1:qt", 0.8, 1, 0, 0},
                           Case{"hang@1:rs", 1.5, 1, 1, 0}, Case{"hang@1:reset", 4.0, 1, 3, 1}}) {
    const auto rig = streaming_with({hang.script});
    rig->run(10.0);
    const SensorCounters counters = rig->sensor.counters();
    EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming) << hang.script;
    EXPECT_LT(rig->longest_gap_s(), hang.most_s) << hang.script;
    EXPECT_EQ(counters.quits, hang.quits) << hang.script;
    EXPECT_EQ(counters.sensor_resets, hang.sensor_resets) << hang.script;
    EXPECT_EQ(counters.usb_resets, hang.usb_resets) << hang.script;
    EXPECT_EQ(rig->false_scans(), 0U) << hang.script;
  }
}

TEST(SensorFault, UnpluggedItStreamsAgainSoonAfterReplug) {
  const auto rig = streaming_with({"unplug@1:0.7"});
  rig->run(5.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming);
  EXPECT_LT(rig->longest_gap_s(), 0.7 + 1.5);
  EXPECT_EQ(rig->false_scans(), 0U);
}

TEST(SensorFault, ABrownOutIsANewClockAndScansComeASecondAfterTheBoot) {
  SimSensorOptions options;
  options.boot_ns = 1'500'000'000;
  const auto rig = streaming_with({"brown-out@1"}, options);
  rig->run(8.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming);
  EXPECT_LT(rig->longest_gap_s(), 1.5 + 1.0);
  EXPECT_GE(rig->new_clocks, 1);
  EXPECT_EQ(rig->false_scans(), 0U);
}

TEST(SensorFault, APowerCycleIsAReplugAndANewClock) {
  const auto rig = streaming_with({"power-cycle@1:0.5"});
  rig->run(8.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming);
  EXPECT_LT(rig->longest_gap_s(), 0.5 + 1.5 + 1.0);  // away, boot, start
  EXPECT_GE(rig->new_clocks, 1);
}

TEST(SensorFault, TroubleIsResetOnceAndTheReasonIsSaid) {
  const auto rig = streaming_with({"trouble@1"});
  rig->run(5.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming);
  EXPECT_LT(rig->longest_gap_s(), 1.0);
  EXPECT_EQ(rig->sensor.counters().troubles, 1U);
  EXPECT_THAT(rig->states, testing::Contains(testing::Pair(SensorState::kRecovering, HasSubstr("51"))));
}

TEST(SensorFault, AbnormalInTheStreamIsSaidInWordsAndNeverGivenUp) {
  const auto rig = streaming_with({"abnormal@1"});
  rig->run(60.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kTrouble);
  EXPECT_THAT(rig->sensor.status().words, HasSubstr("0L"));
  EXPECT_THAT(rig->sensor.status().words, HasSubstr("power"));
  rig->sim.power_on(rig->now_ns);  // somebody switches it off and on
  EXPECT_TRUE(rig->run_until_streaming(20.0));
}

TEST(SensorFault, ASelfCheckIsWaitedFor) {
  const auto rig = streaming_with({});
  rig->run(1.0);
  rig->sensor.ask_for_time();
  rig->run(1.0);
  EXPECT_EQ(rig->sensor.status().state, SensorState::kStreaming);
  EXPECT_EQ(rig->sensor.counters().quits, 0U);
}

TEST(SensorFault, RepeatedScansArriveAsTheyAre) {
  const auto rig = streaming_with({"repeat@1:1"});
  rig->run(2.0);
  EXPECT_EQ(rig->false_scans(), 0U);
  EXPECT_EQ(rig->sensor.counters().faults, 0U);
}

// Random detectable faults: no false scan, and the counters agree with what was injected. tests/soak has the long run.
TEST(SensorFault, RandomFaultsGiveNoFalseScan) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U}) {
    SimSensorOptions options;
    options.fault_rate = 0.02;
    options.seed = seed;
    const auto rig = streaming_with({}, options);
    rig->run(100.0);
    std::uint64_t injected = 0;
    for (const auto& [key, scan] : rig->truth) {
      injected += scan.faults != 0 ? 1U : 0U;
    }
    EXPECT_EQ(rig->false_scans(), 0U) << "seed " << seed;
    EXPECT_EQ(rig->sensor.counters().quits, 0U) << "seed " << seed;
    // Every injected fault costs its scan and no other.
    EXPECT_NEAR(static_cast<double>(rig->scans.size() + injected), static_cast<double>(rig->truth.size()), 2.0)
        << "seed " << seed;
    EXPECT_GE(rig->sensor.counters().faults, injected - 1) << "seed " << seed;
  }
}

// Two bytes of a line change inside the alphabet: one in 64 passes a sum of six bits, and nothing else can see it.
TEST(SensorFault, DamageInsideTheAlphabetPassesAtTheRateOfASixBitSum) {
  SimSensorOptions options;
  options.damage_rate = 0.5;
  const auto rig = streaming_with({}, options);
  rig->run(300.0);
  const double injected = static_cast<double>(rig->sim.faults_injected(SimFaultKind::kDamagedBytes));
  const double passed = static_cast<double>(rig->false_scans());
  EXPECT_NEAR(passed / injected, 1.0 / 63.0, 0.01);  // 5 sigma of 6000
}

}  // namespace
}  // namespace submapd::driver::test
