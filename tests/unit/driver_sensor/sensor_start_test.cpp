// Start-up: patience, identification, roles, the clock, and sensors that are not as they should be.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/driver_sensor/sensor_rig.hpp"

namespace submapd::driver::test {
namespace {

using testing::Each;
using testing::Field;
using testing::HasSubstr;

TEST(SensorStart, StreamsWithinASecondOfASensorThatIsUp) {
  SensorRig rig;
  rig.run(3.0);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(1.0));
  rig.run(10.0);
  EXPECT_GE(rig.scans.size(), 399U);
  EXPECT_EQ(rig.false_scans(), 0U);
  EXPECT_LT(rig.longest_gap_s(), 0.026);
  EXPECT_EQ(rig.sensor.status().identity.serial, "00903971");
  EXPECT_EQ(rig.sensor.status().identity.product, "SOKUIKI Sensor TOP-URG UTM-30LX");
  EXPECT_EQ(rig.sensor.counters().faults, 0U);
}

TEST(SensorStart, WaitsForASensorThatBootsForTwelveSeconds) {
  SimSensorOptions options;
  options.boot_ns = 12'000'000'000;
  SensorRig rig(options);
  rig.plug_in();
  EXPECT_FALSE(rig.run_until_streaming(12.0));
  EXPECT_TRUE(rig.run_until_streaming(1.0));
  EXPECT_EQ(rig.usb_resets, 0);
}

TEST(SensorStart, CopesWithAStreamThatAnEarlierProgramLeftRunning) {
  SensorRig rig;
  rig.run(3.0);
  const std::string earlier = "MD0000108001000\nME0000";  // and half a command
  rig.sim.receive(rig.now_ns, {reinterpret_cast<const std::uint8_t*>(earlier.data()), earlier.size()});
  rig.run(0.51);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(1.0));
  rig.run(1.0);
  EXPECT_EQ(rig.false_scans(), 0U);
}

TEST(SensorStart, CopesWithTimeModeLeftOn) {
  SensorRig rig;
  rig.run(3.0);
  const std::string earlier = "TM0\n";
  rig.sim.receive(rig.now_ns, {reinterpret_cast<const std::uint8_t*>(earlier.data()), earlier.size()});
  rig.run(0.5);
  rig.plug_in();
  EXPECT_TRUE(rig.run_until_streaming(1.0));
}

TEST(SensorStart, MeasuresTheClockOnceBeforeTheFirstStream) {
  SimSensorOptions sim;
  sim.clock_ppm = 100.0;
  SensorRig rig(sim, SensorOptions{});
  rig.run(2.0);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(5.0));
  ASSERT_EQ(rig.samples.size(), 150U);
  EXPECT_GT(rig.samples.back().received_ns - rig.samples.front().sent_ns, 2'000'000'000);
  for (const TimeSample& sample : rig.samples) {
    EXPECT_LE(rig.sim.device_ms(sample.sent_ns), sample.device_ms);
    EXPECT_GE(rig.sim.device_ms(sample.received_ns), sample.device_ms);
  }
}

TEST(SensorStart, AKnownClockIsNotMeasuredAgain) {
  SensorRig rig({}, SensorOptions{});
  rig.clock_known = true;
  rig.run(2.0);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(1.0));
  EXPECT_TRUE(rig.samples.empty());
}

TEST(SensorStart, AtAStandstillTheClockIsMeasuredInBetween) {
  SensorRig rig;
  rig.run(2.0);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(1.0));
  rig.run(1.0);
  rig.sensor.ask_for_time();
  rig.run(2.0);
  EXPECT_EQ(rig.samples.size(), 5U);
  EXPECT_EQ(rig.sensor.status().state, SensorState::kStreaming);
  EXPECT_LT(rig.longest_gap_s(), 0.5);
  EXPECT_EQ(rig.sensor.counters().gaps, 0U);  // the pause was meant
}

TEST(SensorStart, IntensitiesOnlyWhenConfigured) {
  SensorRig plain;
  plain.run(2.0);
  plain.plug_in();
  plain.run(2.0);
  EXPECT_THAT(plain.scans, Each(Field(&HeardScan::has_intensities, false)));
  SensorRig rich;
  rich.intensity = true;
  rich.run(2.0);
  rich.plug_in();
  rich.run(2.0);
  ASSERT_GT(rich.scans.size(), 20U);
  EXPECT_THAT(rich.scans, Each(Field(&HeardScan::has_intensities, true)));
  EXPECT_EQ(rich.false_scans(), 0U);
}

// What came of a self-test, after which the sensor streams as ever.
SelfTest self_test_of(const SimSensorOptions& options) {
  SensorRig rig(options);
  rig.self_test = true;
  rig.plug_in();
  EXPECT_TRUE(rig.run_until(30.0, [&] { return rig.scans.size() >= 40; }));
  EXPECT_FALSE(rig.scans.back().has_intensities);
  EXPECT_TRUE(rig.sensor.status().self_test.has_value());
  return rig.sensor.status().self_test.value_or(SelfTest{});
}

TEST(SensorStart, ASelfTestTriesIntensitiesOnceAndTellsWhatCame) {
  const SelfTest test = self_test_of({});
  EXPECT_TRUE(test.passed());
  EXPECT_EQ(test.scans, SelfTest::kScans);
}

TEST(SensorStart, ASelfTestFindsFirmwareThatNeedsTwoTurns) {
  SimSensorOptions options;
  options.scans_per_me_message = 2;
  const SelfTest test = self_test_of(options);
  EXPECT_FALSE(test.passed());
  EXPECT_EQ(test.lost, SelfTest::kScans - 1);
}

TEST(SensorStart, ASelfTestCountsADamagedScan) {
  SimSensorOptions options;
  options.clock_start_ms = 0xFFFFFF - 2'500;  // the stamps may wrap in it
  options.script = {*parse_sim_fault("garbled-sum@1")};
  const SelfTest test = self_test_of(options);
  EXPECT_FALSE(test.passed());
  EXPECT_EQ(test.scans, SelfTest::kScans);
  EXPECT_EQ(test.damaged, 1);
  EXPECT_EQ(test.lost, 1);
}

TEST(SensorStart, ASelfTestThatHangsTheSensorEndsAndFails) {
  SimSensorOptions options;
  options.script = {*parse_sim_fault("hang@1:qt")};
  const SelfTest test = self_test_of(options);
  EXPECT_FALSE(test.passed());
  EXPECT_LT(test.scans, SelfTest::kScans);
}

TEST(SensorStart, WithoutARoleItStaysQuietAndSaysWhy) {
  SensorRig rig;
  rig.refusal = Error{ErrorCode::kNotFound, "no role"};
  rig.run(2.0);
  rig.plug_in();
  rig.run(5.0);
  EXPECT_EQ(rig.sensor.status().state, SensorState::kUnassigned);
  EXPECT_EQ(rig.sensor.status().words, "no role");
  EXPECT_EQ(rig.sensor.status().identity.serial, "00903971");
  EXPECT_TRUE(rig.scans.empty());
  EXPECT_EQ(rig.sensor.next_time_ns(), LinkClient::kNever_ns);  // nothing is polled
}

TEST(SensorStart, Scip11IsRecognisedSwitchedAndNamed) {
  SimSensorOptions options;
  options.scip11 = true;
  SensorRig rig(options);
  rig.run(2.0);
  rig.plug_in();
  ASSERT_TRUE(rig.run_until_streaming(2.0));
  EXPECT_THAT(rig.sensor.status().words, HasSubstr("SCIP 1.1"));
}

TEST(SensorStart, AMuteDeviceIsNamedAndAskedForEver) {
  SimSensorOptions options;
  options.boot_ns = 3600'000'000'000;
  SensorRig rig(options);
  rig.plug_in();
  rig.run(60.0);
  EXPECT_GE(rig.usb_resets, 2);
  EXPECT_THAT(rig.sensor.status().words, HasSubstr("no SCIP sensor"));
  EXPECT_NE(rig.sensor.next_time_ns(), LinkClient::kNever_ns);
}

TEST(SensorStart, AbnormalIsSaidInWordsWithTheSerialKnown) {
  SimSensorOptions options;
  options.abnormal = true;
  SensorRig rig(options);
  rig.run(2.0);
  rig.plug_in();
  rig.run(30.0);
  EXPECT_EQ(rig.sensor.status().identity.serial, "00903971");
  EXPECT_EQ(rig.sensor.status().state, SensorState::kTrouble);
  EXPECT_THAT(rig.sensor.status().words, HasSubstr("power"));
}

TEST(SensorStart, AnAbnormalSensorThatCanRebootIsRebooted) {
  SimSensorOptions options;
  options.abnormal = true;
  options.reboot_supported = true;
  options.product = "UST-20LX";
  SensorRig rig(options);
  rig.run(2.0);
  rig.plug_in();
  EXPECT_TRUE(rig.run_until_streaming(6.0));
}

}  // namespace
}  // namespace submapd::driver::test
