// The driver from the first byte to the ring, in virtual time: stamps against the truth, lost and repeated scans
// counted.
#include "driver/scan_pipeline.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/driver_sensor/pipeline_rig.hpp"

namespace submapd::driver::test {
namespace {

TEST(ScanPipeline, EveryScanIsInBothRingsWithTheTrueTimeInsideItsBound) {
  SimSensorOptions options;
  options.clock_ppm = 120.0;
  options.usb_frame_ns = 125'000;
  options.packets_per_frame = 2;
  PipelineRig rig(options);
  rig.run_to_scans(2000);
  EXPECT_EQ(rig.pipeline.clock().usb_grid_us(), 125.0);
  EXPECT_EQ(rig.handed_on, 2000U);
  EXPECT_EQ(rig.handed_on_to_recorder, 2000U);
  EXPECT_EQ(rig.outside_bound, 0U);
  EXPECT_EQ(rig.wrong_ranges, 0U);
  EXPECT_EQ(rig.last.lost, 0U);
  EXPECT_EQ(rig.last.index, 1999U);
  EXPECT_LT(rig.last.error_bound_ns, 750'000);
}

TEST(ScanPipeline, TheUsbGridIsMeasuredAndForgottenWithTheLine) {
  for (const std::int64_t frame_ns : {125'000, 1'000'000}) {
    SimSensorOptions options;
    options.clock_ppm = 30.0;
    options.usb_frame_ns = frame_ns;
    options.packets_per_frame = frame_ns == 125'000 ? 2 : 19;
    options.script = {*parse_sim_fault("unplug@5")};
    PipelineRig rig(options);
    rig.run_to_scans(100);
    EXPECT_EQ(rig.pipeline.clock().usb_grid_us(), static_cast<double>(frame_ns) * 1e-3);
    rig.run_to_scans(400);
    EXPECT_EQ(rig.pipeline.clock().usb_grid_us(), 1000.0) << "it may have been plugged in elsewhere";
    rig.rig().sensor.ask_for_time();
    rig.run_to_scans(600);
    EXPECT_EQ(rig.pipeline.clock().usb_grid_us(), static_cast<double>(frame_ns) * 1e-3);
    EXPECT_EQ(rig.outside_bound, 0U);
    EXPECT_EQ(rig.pipeline.clock().contradictions(), 0U);
  }
}

TEST(ScanPipeline, TheStampMayComeBeforeTheFirstBeam) {
  SimSensorOptions options;
  options.stamp_to_step0_ns = 3'125'000;
  ClockOptions clock;
  clock.stamp_to_first_beam_us = 3125.0;
  PipelineRig rig(options, clock);
  rig.run_to_scans(500);
  EXPECT_EQ(rig.outside_bound, 0U);
}

TEST(ScanPipeline, LostAndRepeatedScansAreCountedExactly) {
  SimSensorOptions options;
  options.script = {*parse_sim_fault("skip@1:3"), *parse_sim_fault("garbled-sum@2:2"), *parse_sim_fault("repeat@3:4")};
  PipelineRig rig(options);
  rig.run_to_scans(300);
  EXPECT_EQ(rig.last.lost, 5U);
  EXPECT_EQ(rig.last.repeated, 4U);
  EXPECT_EQ(rig.last.index, 304U);
  EXPECT_EQ(rig.after_fault, 1U);  // told with the scan behind the damaged ones
  EXPECT_EQ(rig.outside_bound, 0U);
}

TEST(ScanPipeline, UnpluggedItGoesOnWithoutMeasuringTheClockAgain) {
  SimSensorOptions options;
  options.script = {*parse_sim_fault("unplug@5:2")};
  PipelineRig rig(options);
  rig.run_to_scans(1000);
  EXPECT_EQ(rig.samples_before_last_epoch, rig.samples) << "TM1 was asked after the reconnect";
  EXPECT_EQ(rig.epochs, 1U);
  EXPECT_EQ(rig.outside_bound, 0U);
}

TEST(ScanPipeline, ABrownOutIsANewEpochWithTrueTimesAgain) {
  SimSensorOptions options;
  options.script = {*parse_sim_fault("brown-out@5")};
  PipelineRig rig(options);
  rig.run_to_scans(1000);
  EXPECT_GE(rig.epochs, 1U);
  EXPECT_EQ(rig.outside_bound, 0U);
}

TEST(ScanPipeline, TheCountersWrapWithoutAJump) {
  SimSensorOptions options;
  options.clock_start_ms = 0xFFFFFF - 12'000;  // wraps some seconds into the stream
  PipelineRig rig(options);
  rig.run_to_scans(1000);
  EXPECT_EQ(rig.outside_bound, 0U);
  EXPECT_EQ(rig.epochs, 0U);
  EXPECT_EQ(rig.last.index, 999U);
}

// Knows each second scan's place.
class EverySecond final : public OdometrySource {
 public:
  bool at(std::int64_t mono_ns, Odometry& odometry) noexcept override {
    odometry = {static_cast<double>(mono_ns), 1.0, 2.0};
    return asked++ % 2 == 0;
  }
  std::uint64_t asked = 0;
};

TEST(ScanPipeline, EachScanIsJoinedWithOdometryOnceForBothRings) {
  PipelineRig rig;
  EverySecond odometry;
  rig.pipeline.join_with(odometry);
  rig.drain_mapper = false;
  rig.run_to_scans(60);
  EXPECT_EQ(odometry.asked, 60U);
  EXPECT_EQ(rig.last.flags & kScanHasOdometry, 0U) << "the sixtieth";
  std::uint64_t with = 0;
  while (const DeviceScan* const scan = rig.mapper_ring.front()) {
    if ((scan->flags & kScanHasOdometry) != 0) {
      ++with;
      EXPECT_EQ(scan->odometry.x_m, static_cast<double>(scan->first_beam_mono_ns));
    }
    rig.mapper_ring.pop();
  }
  EXPECT_EQ(with, 30U);
}

TEST(ScanPipeline, AFullRingDropsAndTheOtherStillGetsAll) {
  PipelineRig rig({}, {}, 4);
  rig.drain_mapper = false;
  rig.run_to_scans(100);
  EXPECT_EQ(rig.handed_on_to_recorder, 100U);
  EXPECT_EQ(rig.mapper_ring.dropped(), 96U);
}

}  // namespace
}  // namespace submapd::driver::test
