// metrics.json of a replay (design section 7).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/filter/mapper.hpp"
#include "slam/graph/optimizer.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/replay/histogram.hpp"

namespace submapd::tools {

struct ReplayMetrics {
  LogSummary log;
  MapperCounters mapper;
  OptimizerCounters optimizer;
  std::vector<ByteBudget> bytes;
  DurationHistogram scan_wall;
  DurationHistogram scan_cpu;
  std::uint64_t scans_dropped = 0;  // gaps in the log's scan index
  double log_s = 0.0;
  double wall_s = 0.0;
  double cpu_s = 0.0;
  double peak_rss_mb = 0.0;
  double particles_sum = 0.0;
  int particles_max = 0;
  std::uint64_t scans_above_one = 0;  // with more than one particle
  std::uint64_t scans_with_odometry = 0;
  double path_m = 0.0;
  std::uint64_t seed = 1;
};

[[nodiscard]] Status write_metrics(const std::filesystem::path& path, const ReplayMetrics& metrics);

// CPU time of the process and of the calling thread, and the largest resident memory so far.
[[nodiscard]] double process_cpu_s();
[[nodiscard]] double thread_cpu_s();
[[nodiscard]] double peak_rss_mb();

}  // namespace submapd::tools
