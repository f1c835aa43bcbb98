#include "daemon/health.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "driver/monotonic.hpp"
#include "proto/lcm_message.hpp"

namespace submapd {
namespace {

constexpr std::array<const char*, 7> kStateNames = {"starting", "mapping",  "paused", "localizing",
                                                    "saving",   "degraded", "failed"};
constexpr std::array<const char*, driver::kSensorRoles> kRoleNames = {"horizontal", "vertical"};

std::int8_t state_of(const ScannerHealth& scanner) {
  using driver::SensorState;
  if (!scanner.present) return sensor_health_t::ABSENT;
  switch (scanner.state) {
    case SensorState::kStreaming:
      return sensor_health_t::RUNNING;
    case SensorState::kRecovering:
      return sensor_health_t::SILENT;
    case SensorState::kTrouble:
    case SensorState::kUnassigned:
      return sensor_health_t::FAILED;
    default:
      return sensor_health_t::STARTING;
  }
}

sensor_health_t message_of(const ScannerHealth& scanner) {
  sensor_health_t row{};
  row.state = state_of(scanner);
  row.scans = static_cast<std::int64_t>(scanner.scans);
  row.dropped = static_cast<std::int64_t>(scanner.dropped);
  row.bad_frames = static_cast<std::int64_t>(scanner.bad_frames);
  row.reconnects = static_cast<std::int64_t>(scanner.reconnects);
  row.rate_hz = scanner.rate_hz;
  return row;
}

std::string trouble_of(const ScannerHealth& scanner, const char* role) {
  if (!scanner.configured) return {};
  if (!scanner.present && scanner.words.empty()) {
    return fmt::format("{} scanner {} is not plugged in", role, scanner.serial);
  }
  if (!scanner.present) return fmt::format("{} scanner {} is not found; {}", role, scanner.serial, scanner.words);
  if (scanner.words.empty()) return {};
  return fmt::format("{} scanner: {}", role, scanner.words);
}

nlohmann::json json_of(const SaveProgress& save) {
  constexpr std::array<const char*, 4> kNames = {"none", "working", "done", "failed"};
  nlohmann::json json = {{"state", kNames[static_cast<std::size_t>(save.state)]},
                         {"name", save.name},
                         {"percent", save.percent},
                         {"path", save.path},
                         {"message", save.status.message()}};
  if (save.ended_ns > 0) json["ago_s"] = static_cast<double>(driver::monotonic_now_ns() - save.ended_ns) * 1e-9;
  return json;
}

nlohmann::json json_of(const std::optional<OdometryCounters>& odometry) {
  const OdometryCounters counters = odometry.value_or(OdometryCounters{});
  return {{"configured", odometry.has_value()},
          {"taken", counters.taken},
          {"bad", counters.bad},
          {"foreign", counters.foreign},
          {"stale", counters.stale},
          {"crowded", counters.crowded},
          {"jumps", counters.jumps},
          {"dropped", counters.dropped},
          {"joined", counters.joined}};
}

}  // namespace

const char* state_name(std::int8_t state) {
  return state >= 0 && static_cast<std::size_t>(state) < kStateNames.size()
             ? kStateNames[static_cast<std::size_t>(state)]
             : "unknown";
}

std::string trouble_of(const Health& health) {
  if (!health.optimizer_trouble.empty()) return "the optimizer has stopped: " + health.optimizer_trouble;
  if (!health.recorder.trouble.empty()) return health.recorder.trouble;
  if (health.recorder.disk == DiskState::kLast) return "the disk is full: raw scans are not recorded; make room";
  if (!health.input_trouble.empty()) return health.input_trouble;
  if (!health.scanners[0].configured) {
    return "no scanner has the role to map; say which with: submapctl sensors --assign H=SERIAL V=SERIAL";
  }
  for (std::size_t i = 0; i < health.scanners.size(); ++i) {
    if (std::string words = trouble_of(health.scanners[i], kRoleNames[i]); !words.empty()) return words;
  }
  if (health.mapper.last_lost) return "the scans fit nowhere; go slower, or back to where they did";
  if (health.recorder.disk == DiskState::kLow) {
    return fmt::format("only {} MB left on the disk", health.recorder.disk_free_bytes >> 20);
  }
  if (health.optimizer.submaps_frozen > 0) {
    return fmt::format(
        "the site is larger than the graph's memory: the oldest {} sub-maps stay as they are and are not recognised "
        "any "
        "more; raise [budget] graph, or map the rest in a new run",
        health.optimizer.submaps_frozen);
  }
  if (!health.button_trouble.empty()) return health.button_trouble;
  if (health.odometry && health.odometry->silent) {
    return "no odometry that can be used comes over LCM; mapping goes on without it";
  }
  if (!health.publisher.lcm) return "no network for LCM; mapping goes on without it";
  return {};
}

std::int8_t state_of(const Health& health) {
  if (!health.optimizer_trouble.empty()) return health_t::FAILED;
  if (health.save.state == SaveState::kWorking) return health_t::SAVING;
  if (health.paused) return health_t::PAUSED;
  if (!trouble_of(health).empty()) return health_t::DEGRADED;
  return health.mapper.scans == 0 ? health_t::STARTING : health_t::MAPPING;
}

std::string words_of(const Health& health) {
  std::string words =
      fmt::format("{}: {} scans at {:.0f} and {:.0f} Hz, {} sub-maps, {} loops", state_name(state_of(health)),
                  health.mapper.scans, health.scanners[0].rate_hz, health.scanners[1].rate_hz,
                  health.recorder.last_submap + 1, health.optimizer.loops_confirmed);
  if (const std::string trouble = trouble_of(health); !trouble.empty()) words += "; " + trouble;
  return words;
}

health_t message_of(const Health& health) {
  health_t m{};
  m.utime = health.utime_us;
  put_uuid(health.cart_id, m.cart);
  put_uuid(health.run_id, m.run);
  m.state = state_of(health);
  m.degenerate = health.mapper.degenerate ? 1 : 0;
  m.horizontal = message_of(health.scanners[0]);
  m.horizontal.dropped = static_cast<std::int64_t>(health.mapper.skipped);
  m.vertical = message_of(health.scanners[1]);
  m.last_submap = static_cast<std::int32_t>(health.recorder.last_submap);
  m.last_chunk_seq = health.publisher.last_chunk_seq;
  m.graph_version = static_cast<std::int32_t>(health.graph_version);
  m.optimized_submaps = static_cast<std::int32_t>(health.optimizer.submaps);
  m.loops_confirmed = static_cast<std::int32_t>(health.optimizer.loops_confirmed);
  m.loops_pending = static_cast<std::int32_t>(health.optimizer.loops_pending);
  m.particles = health.mapper.particles;
  m.scan_ms_p99 = health.publisher.scan_ms_p99;
  m.recorder_dropped =
      static_cast<std::int64_t>(health.recorder.raw_lost + health.scanners[0].dropped + health.scanners[1].dropped);
  m.publisher_dropped = static_cast<std::int64_t>(health.publisher.dropped);
  m.submaps_reread = static_cast<std::int64_t>(health.optimizer_thread.reread);
  m.rss_bytes = static_cast<std::int64_t>(health.rss_bytes);
  m.budget_bytes_used = static_cast<std::int64_t>(health.optimizer.bytes_used);
  m.budget_bytes_limit = static_cast<std::int64_t>(health.budget_bytes);
  m.disk_free_bytes = static_cast<std::int64_t>(health.recorder.disk_free_bytes);
  m.disk_state = static_cast<std::int8_t>(health.recorder.disk);
  m.message = trouble_of(health);
  return m;
}

nlohmann::json json_of(const Health& health) {
  nlohmann::json scanners = nlohmann::json::object();
  for (std::size_t i = 0; i < health.scanners.size(); ++i) {
    const ScannerHealth& s = health.scanners[i];
    scanners[kRoleNames[i]] = {{"configured", s.configured},
                               {"present", s.present},
                               {"serial", s.serial},
                               {"state", std::string(driver::name(s.state))},
                               {"words", s.words},
                               {"scans", s.scans},
                               {"dropped", s.dropped},
                               {"bad_frames", s.bad_frames},
                               {"reconnects", s.reconnects},
                               {"rate_hz", s.rate_hz},
                               {"clock_error_ms", s.clock_error_ms}};
  }
  return {{"utime_us", health.utime_us},
          {"cart", health.cart_id.to_string()},
          {"run_id", health.run_id.to_string()},
          {"run", health.run},
          {"state", state_name(state_of(health))},
          {"message", trouble_of(health)},
          {"input", health.input},
          {"input_ended", health.input_ended},
          {"scanners", scanners},
          {"mapper",
           {{"scans", health.mapper.scans},
            {"skipped", health.mapper.skipped},
            {"missing", health.mapper.missing},
            {"lost", health.mapper.lost},
            {"by_odometry", health.mapper.by_odometry},
            {"particles", health.mapper.particles},
            {"n_eff", health.mapper.n_eff},
            {"degenerate", health.mapper.degenerate},
            {"stamp_us", health.mapper.stamp_us}}},
          {"recorder",
           {{"raw_scans", health.recorder.raw_scans},
            {"raw_lost", health.recorder.raw_lost},
            {"last_submap", health.recorder.last_submap},
            {"raw_bytes", health.recorder.raw_bytes},
            {"disk_free_bytes", health.recorder.disk_free_bytes},
            {"disk_minutes", health.disk_minutes}}},
          {"publisher",
           {{"lcm", health.publisher.lcm},
            {"poses", health.publisher.poses},
            {"pose_hz", health.pose_hz},
            {"posted", health.publisher.posted},
            {"chunks", health.publisher.chunks},
            {"dropped", health.publisher.dropped},
            {"scan_ms_p99", health.publisher.scan_ms_p99}}},
          {"optimizer",
           {{"submaps", health.optimizer.submaps},
            {"condensed", health.optimizer.submaps_condensed},
            {"frozen", health.optimizer.submaps_frozen},
            {"graph_bytes", health.optimizer.bytes_used},
            {"refused_for_memory", health.optimizer.refused_for_memory},
            {"graph_version", health.graph_version},
            {"loops_confirmed", health.optimizer.loops_confirmed},
            {"loops_pending", health.optimizer.loops_pending},
            {"chunks", health.optimizer_thread.chunks.received},
            {"completed", health.optimizer_thread.chunks.completed},
            {"damaged", health.optimizer_thread.chunks.damaged},
            {"evicted", health.optimizer_thread.chunks.evicted},
            {"lost", health.optimizer_thread.lost},
            {"reread", health.optimizer_thread.reread},
            {"graphs", health.optimizer_thread.graphs_published},
            {"solves", health.optimizer.solves},
            {"solve_ms_max", health.optimizer.solve_ms_max},
            {"forged", health.optimizer_thread.chunks.forged},
            {"foreign", health.optimizer_thread.chunks.foreign},
            {"bad", health.optimizer_thread.chunks.bad}}},
          {"save", json_of(health.save)},
          {"inputs", {{"taken", health.inputs.taken}, {"bad", health.inputs.bad}, {"dropped", health.inputs.dropped}}},
          {"odometry", json_of(health.odometry)},
          {"control",
           {{"turned_away", health.clients.turned_away},
            {"shut_out", health.clients.shut_out},
            {"hook_failed", health.hook_failed},
            {"longest_turn_ms", health.longest_turn_ms}}},
          {"memory", {{"rss_bytes", health.rss_bytes}, {"budget_bytes", health.budget_bytes}}}};
}

bool differs(const Health& before, const Health& now) {
  bool different = state_of(before) != state_of(now) || before.mapper.degenerate != now.mapper.degenerate ||
                   before.recorder.last_submap != now.recorder.last_submap ||
                   before.graph_version != now.graph_version || trouble_of(before) != trouble_of(now);
  for (std::size_t i = 0; i < now.scanners.size(); ++i) {
    different = different || state_of(before.scanners[i]) != state_of(now.scanners[i]);
  }
  return different;
}

}  // namespace submapd
