#include "tools/replay/scan_statistics.hpp"

#include <algorithm>

namespace submapd::tools {

ScanReport ScanStatistics::process(Mapper& mapper, const Scan& scan) {
  const double cpu_s = thread_cpu_s();
  const auto start = std::chrono::steady_clock::now();
  const ScanReport report = mapper.process(scan);
  wall.add(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
  cpu.add((thread_cpu_s() - cpu_s) * 1e3);
  particles_sum += report.particles;
  particles_max = std::max(particles_max, report.particles);
  if (report.particles > 1) ++above_one;
  if (report.odometry_used) ++with_odometry;
  if (!first_stamp_us) {
    first_stamp_us = last_stamp_us = scan.stamp_us;
    first_index = next_index = scan.index;
  }
  last_stamp_us = std::max(last_stamp_us, scan.stamp_us);
  if (scan.index > next_index) dropped += scan.index - next_index;
  next_index = scan.index + 1;
  ++scans;
  return report;
}

void ScanStatistics::add(const ScanStatistics& later) {
  if (!later.first_stamp_us) return;
  if (!first_stamp_us) {
    *this = later;
    return;
  }
  wall.add(later.wall);
  cpu.add(later.cpu);
  scans += later.scans;
  dropped += later.dropped + (later.first_index > next_index ? later.first_index - next_index : 0);
  particles_sum += later.particles_sum;
  particles_max = std::max(particles_max, later.particles_max);
  above_one += later.above_one;
  with_odometry += later.with_odometry;
  last_stamp_us = std::max(last_stamp_us, later.last_stamp_us);
  next_index = later.next_index;
}

void ScanStatistics::write_to(ReplayMetrics& metrics) const {
  metrics.scan_wall = wall;
  metrics.scan_cpu = cpu;
  metrics.scans_dropped = dropped;
  metrics.particles_sum = particles_sum;
  metrics.particles_max = particles_max;
  metrics.scans_above_one = above_one;
  metrics.scans_with_odometry = with_odometry;
  if (first_stamp_us) metrics.log_s = static_cast<double>(last_stamp_us - *first_stamp_us) * 1e-6;
}

SpooledPose spooled(const ScanReport& report) {
  return {report.stamp_us, report.keyframe_scan_index, report.keyframe_from_base, report.keyframe_step,
          report.keyframe, report.keyframe_linked};
}

}  // namespace submapd::tools
