// From the mapper ring to the reports our code neither allocates nor locks, sub-map after sub-map: counted over a
// drive.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "daemon/mapper_thread.hpp"
#include "daemon/odometry_track.hpp"
#include "slam/base/worker_pool.hpp"
#include "tests/support/call_counter.hpp"
#include "tools/sim/office.hpp"
#include "tools/sim/simulator.hpp"

namespace submapd {
namespace {

using test::allocations;
using test::armed;
using test::locks;

TEST(QuietMapping, TheCountersCount) {
  test::expect_the_counters_count();
}

TEST(QuietMapping, NothingIsAllocatedOrLockedBetweenTwoScans) {
  tools::MotionOptions motion_options;
  motion_options.duration_s = 12.0;
  motion_options.speed_m_s = 2.0;
  Expected<tools::Motion> motion = tools::Motion::along(tools::office_tour(), motion_options);
  ASSERT_TRUE(motion.has_value());
  tools::Simulator simulator(std::make_shared<const tools::World>(tools::office_world()),
                             std::make_shared<const tools::Motion>(std::move(*motion)), {});
  MapperOptions options;
  options.limits.path_m = 4.0;
  SerialPool pool;
  Mapper mapper(options, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
  ScanStamper stamper(RunClock(0), utm30lx_geometry());
  ReportRing reports(8);
  auto measured = std::make_unique<driver::DeviceScan>();
  int submaps = 0;
  allocations = 0;
  locks = 0;
  while (const std::optional<Scan> scan = simulator.next()) {
    measured->first_beam_mono_ns = scan->stamp_us * 1000;
    measured->index = scan->index;
    measured->beams = static_cast<std::uint32_t>(scan->ranges_mm.size());
    std::copy(scan->ranges_mm.begin(), scan->ranges_mm.end(), measured->ranges_mm.begin());
    armed = scan->index > 0;  // the first may
    const ScanReport report = mapper.process(stamper.stamp(*measured));
    MappedScan* const slot = reports.claim();
    *slot = {report, 0};
    reports.publish();
    armed = false;
    ASSERT_NE(reports.front(), nullptr);
    reports.pop();
    ASSERT_EQ(allocations, 0U) << "scan " << scan->index;
    ASSERT_EQ(locks, 0U) << "scan " << scan->index;
    submaps += mapper.take_finished().has_value() ? 1 : 0;
  }
  EXPECT_GE(submaps, 2);
}

TEST(QuietMapping, OdometryIsJoinedQuietly) {
  OdometryRing ring(64);
  OdometryTrack track(ring);
  driver::Odometry joined;
  allocations = 0;
  locks = 0;
  for (std::int64_t scan = 1; scan < 2000; ++scan) {
    for (std::int64_t sample = 0; sample < scan % 5; ++sample) {
      *ring.claim() = {scan * 25'000'000 + sample * 6'000'000, {0.01 * static_cast<double>(scan), 0.0, 0.0}, 1};
      ring.publish();
    }
    armed = true;
    (void)track.at(scan * 25'000'000, joined);
    armed = false;
  }
  EXPECT_EQ(allocations, 0U);
  EXPECT_EQ(locks, 0U);
  EXPECT_GT(track.joined(), 1000U);
}

}  // namespace
}  // namespace submapd
