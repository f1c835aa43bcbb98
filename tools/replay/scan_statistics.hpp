// What a replay counts for each scan that it maps.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "slam/filter/mapper.hpp"
#include "slam/output/pose_spool.hpp"
#include "tools/replay/histogram.hpp"
#include "tools/replay/metrics.hpp"

namespace submapd::tools {

// One thread's; those of several are added up in the order of the log.
struct ScanStatistics {
  DurationHistogram wall;
  DurationHistogram cpu;
  std::uint64_t scans = 0;
  std::uint64_t dropped = 0;  // gaps in the log's scan index
  double particles_sum = 0.0;
  int particles_max = 0;
  std::uint64_t above_one = 0;  // with more than one particle
  std::uint64_t with_odometry = 0;
  std::optional<std::int64_t> first_stamp_us;
  std::int64_t last_stamp_us = 0;
  std::uint64_t first_index = 0;
  std::uint64_t next_index = 0;

  // Maps a scan and counts it.
  ScanReport process(Mapper& mapper, const Scan& scan);
  // What follows in the log.
  void add(const ScanStatistics& later);
  void write_to(ReplayMetrics& metrics) const;
};

// What the spool keeps of a report.
[[nodiscard]] SpooledPose spooled(const ScanReport& report);

}  // namespace submapd::tools
