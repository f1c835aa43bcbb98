#include "tools/replay/replay.hpp"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <optional>

#include "daemon/allocator.hpp"
#include "daemon/thread_pool.hpp"
#include "daemon/version.hpp"
#include "slam/output/run_outputs.hpp"
#include "tools/replay/chunked_mapping.hpp"
#include "tools/replay/recording.hpp"
#include "tools/replay/replay_report.hpp"

namespace submapd::tools {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// The log through one mapper, scan by scan.
class LiveMapping {
 public:
  LiveMapping(const ReplayOptions& options, const Uuid& cart, const Uuid& run, const MappingOutputs& out)
      : out_(out),
        pool_(options.threads),
        mapper_(std::make_unique<Mapper>(options.configuration.mapper, cart, run, pool_)) {}

  Status process(const Scan& scan) {
    const ScanReport report = scans_.process(*mapper_, scan);
    if (Status status = out_.poses.add(spooled(report)); !status.ok()) return status;
    const Pose2 map_from_base = compose(out_.feed.map_from_odom(), report.odom_from_base);
    if (Status status = out_.filter_trajectory.add(scan.stamp_us, map_from_base); !status.ok()) return status;
    return hand_on_finished();
  }

  // Closes the last sub-map. The mapper's maps make room for the final graph and for the map that is saved.
  Status finish() {
    mapper_->finish_run();
    if (Status status = hand_on_finished(); !status.ok()) return status;
    scans_.write_to(out_.metrics);
    out_.metrics.mapper = mapper_->counters();
    out_.metrics.bytes = mapper_->budgets();
    mapper_.reset();
    return {};
  }

 private:
  Status hand_on_finished() {
    const std::optional<FinishedSubmap> finished = mapper_->take_finished();
    return finished ? out_.feed.feed(*finished) : Status();
  }

  const MappingOutputs& out_;
  ThreadPool pool_;
  std::unique_ptr<Mapper> mapper_;
  ScanStatistics scans_;
};

Status map_in_order(const ReplayOptions& options, LogReader& reader, const Uuid& cart, const Uuid& run,
                    const MappingOutputs& out) {
  LiveMapping mapping(options, cart, run, out);
  reserve_heap(options.configuration.submap_cache_bytes + options.configuration.graph_bytes +
               work_heap_bytes(options.configuration.graph_bytes));
  ReplayProgress shown;
  for (;;) {
    const Expected<std::optional<Scan>> scan = reader.next();
    if (!scan) return scan.error();
    if (!scan->has_value()) break;
    if (Status status = mapping.process(**scan); !status.ok()) return status;
    if (++shown.scans % 50 == 0) {
      shown.share = reader.progress();
      shown.submaps = out.feed.submaps();
      shown.loops = out.feed.confirmed_loops();
      out.progress(shown);
    }
  }
  out.metrics.log = reader.summary();
  return mapping.finish();
}

// Each worker opens the log for itself.
Status check_shareable(const std::string& log) {
  std::error_code error;
  if (std::filesystem::is_regular_file(log, error) || std::filesystem::is_directory(log, error)) return {};
  return {StatusCode::kInvalidArgument,
          fmt::format("{}: --workers reads the log more than once and takes a file or a run's folder; "
                      "copy it to a file or leave --workers out",
                      log)};
}

Status prepare_folder(const std::filesystem::path& out) {
  std::error_code error;
  std::filesystem::create_directories(out, error);
  for (const char* const name : {"submaps", "journal", "poses"}) {
    if (!error) std::filesystem::remove_all(out / name, error);
  }
  if (error) {
    return {StatusCode::kIo, fmt::format("cannot prepare the folder {}: {}", out.string(), error.message())};
  }
  return {};
}

}  // namespace

Expected<ReplayResult> replay(const ReplayOptions& options,
                              const std::function<void(const ReplayProgress&)>& progress) {
  const Clock::time_point start = Clock::now();
  if (options.workers > 0) {
    if (Status status = check_shareable(options.log); !status.ok()) return failure(status);
  }
  Expected<Recording> recording = open_recording(options.log, options.configuration.lcm.prefix);
  if (!recording) return failure(recording.error());
  if (Status status = prepare_folder(options.out); !status.ok()) return failure(status);
  Expected<std::unique_ptr<SubmapArchive>> archive =
      SubmapArchive::open(options.out / "submaps", options.configuration.submap_cache_bytes);
  if (!archive) return failure(archive.error());
  const Expected<std::unique_ptr<PoseSpool>> poses = PoseSpool::open(options.out / "poses");
  if (!poses) return failure(poses.error());

  // A recorded run's sub-maps keep their identity, so that replay gives the very files that the daemon wrote.
  const std::uint64_t seed = options.configuration.mapper.seed;
  const Uuid cart = recording->origin ? recording->origin->cart : Uuid::from_seed(seed, 1);
  const Uuid run = recording->origin ? recording->origin->run : Uuid::from_seed(seed, 2);
  ReplayMetrics metrics;
  metrics.seed = seed;
  ReplayProgress shown;
  const auto tell = [&](const ReplayProgress& p) { progress(shown = p); };
  SubmapFeed feed(options.configuration, options.loops, cart, run, std::move(*archive));
  TrajectoryFile filter_trajectory(options.out / "trajectory_filter.tum");
  const MappingOutputs mapping{feed, **poses, filter_trajectory, metrics, tell};
  Status mapped;
  if (options.workers > 0) {
    recording->reader.reset();
    mapped = map_in_chunks({.log = options.log,
                            .configuration = options.configuration,
                            .chunks = {},
                            .workers = options.workers,
                            .threads = options.threads,
                            .folder = options.out,
                            .cart = cart,
                            .run = run},
                           mapping);
  } else {
    mapped = map_in_order(options, *recording->reader, cart, run, mapping);
  }
  if (!mapped.ok()) return failure(mapped);
  if (Status status = filter_trajectory.commit(); !status.ok()) return failure(status);
  if (Status status = feed.write_journal(options.out / "journal"); !status.ok()) return failure(status);
  shown.share = 1.0;
  shown.stage = "optimising";
  progress(shown);
  Expected<FinalResult> result = feed.finish(metrics);
  if (!result) return failure(result.error());
  shown.stage = "saving";
  progress(shown);

  const RunOutputs outputs{.folder = options.out,
                           .name = std::filesystem::path(options.log).filename().string(),
                           .subtitle = fmt::format("submapd {}, seed {}", kVersion, metrics.seed),
                           .mapper = options.configuration.mapper,
                           .raster_bytes = options.configuration.map_raster_bytes,
                           .result = *result,
                           .submaps = feed.archive(),
                           .poses = **poses,
                           .scans = (*poses)->size(),
                           .marks = {}};
  const Expected<RunOutputsSummary> written = write_run_outputs(outputs);
  if (!written) return failure(written.error());
  if (Status status = write_replay_report(options.out / "report.json", written->quality, *result); !status.ok()) {
    return failure(status);
  }
  metrics.path_m = written->path_m;
  metrics.bytes.push_back(written->raster);
  metrics.wall_s = seconds_since(start);
  metrics.cpu_s = process_cpu_s();
  metrics.peak_rss_mb = peak_rss_mb();
  if (Status status = write_metrics(options.out / "metrics.json", metrics); !status.ok()) return failure(status);

  ReplayResult done;
  done.summary = fmt::format(
      "{} scans over {:.0f} s, path {:.1f} m, {} sub-maps, {} loops confirmed ({} pending, {} rejected)\n"
      "{:.1f} s CPU, {:.2f} ms a scan on average, {:.0f} MB of memory at most\n",
      metrics.mapper.scans, metrics.log_s, metrics.path_m, metrics.optimizer.submaps, metrics.optimizer.loops_confirmed,
      metrics.optimizer.loops_pending, metrics.optimizer.loops_rejected, metrics.cpu_s, metrics.scan_cpu.mean_ms(),
      metrics.peak_rss_mb);
  if (metrics.mapper.breaks > 0) {
    done.summary += fmt::format("warning: tracking broke {} times; parts of the map may not be tied together\n",
                                metrics.mapper.breaks);
  }
  if (metrics.mapper.pool_refusals > 0 || metrics.mapper.keyframes_refused > 0) {
    done.summary += fmt::format(
        "warning: a sub-map was full: {} cells or surfaces and {} key-frames are missing from it; raise [budget] "
        "map_blocks and surface_faces, [submap] keyframes\n",
        metrics.mapper.pool_refusals, metrics.mapper.keyframes_refused);
  }
  if (metrics.log.skipped_records > 0) {
    done.summary +=
        fmt::format("warning: {} damaged records of the log were skipped, first: {}\n", metrics.log.skipped_records,
                    metrics.log.problems.empty() ? "?" : metrics.log.problems.front());
  }
  if (metrics.mapper.odometry_rejected) {
    done.summary += "warning: the log's odometry contradicts the scans and was not used (see --odometry)\n";
  }
  done.summary += fmt::format("map: {}\n", (options.out / "map.png").string());
  return done;
}

}  // namespace submapd::tools
