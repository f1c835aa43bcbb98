// Scans of a run that goes on: what was recorded before is mapped again, but for the hours in which the cart stood.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/mapper_thread.hpp"
#include "tools/sim/office.hpp"
#include "tools/sim/simulator.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kHour_us = 3'600'000'000;

std::vector<Scan> first_scans(std::size_t count) {
  tools::MotionOptions motion_options;
  motion_options.duration_s = 10.0;
  Expected<tools::Motion> motion = tools::Motion::along(tools::office_tour(), motion_options);
  if (!motion) return {};
  tools::Simulator simulator(std::make_shared<const tools::World>(tools::office_world()),
                             std::make_shared<const tools::Motion>(std::move(*motion)), {});
  std::vector<Scan> scans;
  while (scans.size() < count) {
    std::optional<Scan> scan = simulator.next();
    if (!scan) break;
    scans.push_back(std::move(*scan));
  }
  return scans;
}

TEST(MapperBacklog, IsNotMappedWhereTheCartStood) {
  constexpr std::size_t kDriven = 100;
  std::vector<Scan> scans = first_scans(2 * kDriven);
  ASSERT_EQ(scans.size(), 2 * kDriven);
  // Two hours between the halves. Scans of then fit nowhere: one that is mapped is counted as lost.
  for (std::size_t i = kDriven; i < scans.size(); ++i) {
    scans[i].stamp_us += 2 * kHour_us;
    scans[i].index += 1'000'000;
  }
  const Standstill stood{scans[kDriven - 1].stamp_us + 1, scans[kDriven].stamp_us - 1};
  std::vector<Scan> standing;
  for (int i = 0; i < 500; ++i) {
    Scan scan = scans[0];
    scan.index = scans[kDriven - 1].index + 1 + static_cast<std::uint64_t>(i);
    scan.stamp_us = stood.first_us + i * (kHour_us / 250);
    std::fill(scan.ranges_mm.begin(), scan.ranges_mm.end(), static_cast<std::uint16_t>(300 + i));
    standing.push_back(std::move(scan));
  }
  scans.insert(scans.begin() + kDriven, standing.begin(), standing.end());

  driver::ScanRing ring(8);
  driver::Doorbell bell = make_doorbell();
  driver::Doorbell input_bell = make_doorbell();
  RoomBell room(input_bell);
  const PauseWindow pause;
  ReportRing to_publisher(8);
  ReportRing to_recorder(64);
  MapperThreadOptions options;
  options.geometry = utm30lx_geometry();
  options.workers = 0;
  options.real_time = false;
  options.resumed = true;
  options.standstills = {stood};
  options.backlog = [next = scans.begin(), end = scans.end()]() mutable {
    return next == end ? std::nullopt : std::optional(*next++);
  };
  options.after_us = scans.back().stamp_us;
  MapperThread mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), RunClock(0), ring, bell, room, pause,
                      to_publisher, to_recorder);
  ScanReport before;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    while (to_recorder.front() == nullptr) {
      (void)mapper.take_finished();
      std::this_thread::yield();
    }
    const ScanReport report = to_recorder.front()->report;
    to_recorder.pop();
    mapper.reports_taken();
    EXPECT_EQ(report.stamp_us, scans[i].stamp_us) << "each scan has a pose";
    EXPECT_EQ(report.scan_index, scans[i].index);
    if (stood.contains(report.stamp_us)) {
      EXPECT_FALSE(report.keyframe);
      EXPECT_EQ(report.keyframe_scan_index, before.keyframe_scan_index);
      EXPECT_EQ(report.keyframe_from_base.x, before.keyframe_from_base.x);
    }
    before = report;
  }
  EXPECT_EQ(mapper.state().lost, 0U);
  EXPECT_TRUE(mapper.finish());
}

}  // namespace
}  // namespace submapd
