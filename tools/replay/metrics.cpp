#include "tools/replay/metrics.hpp"

#include <sys/resource.h>
#include <ctime>

#include <nlohmann/json.hpp>

#include "daemon/version.hpp"
#include "slam/base/atomic_file.hpp"

namespace submapd::tools {
namespace {

double clock_s(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

nlohmann::ordered_json distribution(const DurationHistogram& h) {
  return {{"mean", h.mean_ms()},
          {"p50", h.quantile_ms(0.5)},
          {"p99", h.quantile_ms(0.99)},
          {"p999", h.quantile_ms(0.999)},
          {"max", h.max_ms()}};
}

}  // namespace

double process_cpu_s() {
  return clock_s(CLOCK_PROCESS_CPUTIME_ID);
}
double thread_cpu_s() {
  return clock_s(CLOCK_THREAD_CPUTIME_ID);
}

double peak_rss_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024.0 / 1e6;
}

Status write_metrics(const std::filesystem::path& path, const ReplayMetrics& m) {
  const auto scans = static_cast<double>(std::max<std::uint64_t>(m.mapper.scans, 1));
  nlohmann::ordered_json bytes = nlohmann::ordered_json::object();
  for (const ByteBudget& b : m.bytes) bytes[b.name] = {{"used", b.used}, {"peak", b.peak}, {"limit", b.limit}};
  const nlohmann::ordered_json json = {
      {"scans", m.mapper.scans},
      {"scans_dropped", m.scans_dropped},
      {"scans_lost", m.mapper.lost_scans},
      {"log_s", m.log_s},
      {"wall_s", m.wall_s},
      {"cpu_s", m.cpu_s},
      {"realtime_factor", m.wall_s > 0.0 ? m.log_s / m.wall_s : 0.0},
      {"path_m", m.path_m},
      {"scan_ms", distribution(m.scan_wall)},
      {"scan_cpu_ms", distribution(m.scan_cpu)},
      {"peak_rss_mb", m.peak_rss_mb},
      {"bytes", bytes},
      {"particles",
       {{"mean", m.particles_sum / scans},
        {"max", m.particles_max},
        {"share_above_1", static_cast<double>(m.scans_above_one) / scans},
        {"coalescences", m.mapper.forced_coalescences}}},
      {"keyframes", m.mapper.keyframes},
      {"submaps", m.optimizer.submaps},
      {"submaps_condensed", m.optimizer.submaps_condensed},
      {"submaps_frozen", m.optimizer.submaps_frozen},
      {"breaks", m.mapper.breaks},
      {"searches", m.mapper.searches},
      {"pool_refusals", m.mapper.pool_refusals},
      {"keyframes_refused", m.mapper.keyframes_refused},
      {"loops",
       {{"candidates", m.optimizer.loop_candidates},
        {"confirmed", m.optimizer.loops_confirmed},
        {"pending", m.optimizer.loops_pending},
        {"rejected", m.optimizer.loops_rejected}}},
      {"landmarks", m.optimizer.landmarks},
      {"solver", {{"calls", m.optimizer.solves}, {"ms_max", m.optimizer.solve_ms_max}}},
      {"degenerate_s", m.mapper.degenerate_s},
      {"odometry", {{"scans", m.scans_with_odometry}, {"rejected", m.mapper.odometry_rejected}}},
      {"log",
       {{"skipped_records", m.log.skipped_records},
        {"skipped_bytes", m.log.skipped_bytes},
        {"backward_stamps", m.log.backward_stamps}}},
      {"seed", m.seed},
      {"version", kVersion}};
  const std::string text = json.dump(2) + "\n";
  return atomic_write_file(path, std::as_bytes(std::span(text)));
}

}  // namespace submapd::tools
