#include "tools/replay/replay.hpp"

#include <fmt/format.h>
#include <lcm/lcm-cpp.hpp>

#include <chrono>
#include <memory>
#include <optional>
#include <vector>

#include "daemon/allocator.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/submap_journal.hpp"
#include "daemon/submap_publisher.hpp"
#include "daemon/thread_pool.hpp"
#include "daemon/version.hpp"
#include "proto/scan_conversion.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/output/run_outputs.hpp"
#include "slam/output/trajectory_file.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/replay/metrics.hpp"
#include "tools/replay/replay_report.hpp"

namespace submapd::tools {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// A log's scans, and whose they are: what the first one says, nothing if the log does not tell.
struct Recording {
  std::unique_ptr<LogReader> reader;
  std::optional<ScanOrigin> origin;
};

Expected<Recording> open_recording(const std::string& log, const std::string& prefix) {
  // Filled while the reader looks for the first scan.
  const auto origin = std::make_shared<std::optional<ScanOrigin>>();
  const auto decoder = [channel = Channels(prefix).scan_h, origin](
                           std::string_view name, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
    if (name != channel) return std::optional<Scan>{};
    Expected<ScanMessage> message = decode_scan(data);
    if (!message) return tl::unexpected(message.error());
    if (!*origin && message->origin.run != Uuid{}) *origin = message->origin;
    return std::optional<Scan>(std::move(message->scan));
  };
  Expected<std::unique_ptr<LogReader>> reader = open_log(log, decoder);
  if (!reader) return failure(reader.error());
  return Recording{std::move(*reader), *origin};
}

// Everything between a scan and the optimised graph.
class Pipeline {
 public:
  // A recorded run's sub-maps keep their identity, so that replay gives the very files that the daemon wrote.
  Pipeline(const ReplayOptions& options, const std::optional<ScanOrigin>& origin,
           std::unique_ptr<SubmapArchive> archive, std::unique_ptr<PoseSpool> spool)
      : options_(options),
        cart_(origin ? origin->cart : Uuid::from_seed(options.configuration.mapper.seed, 1)),
        run_(origin ? origin->run : Uuid::from_seed(options.configuration.mapper.seed, 2)),
        archive_(std::move(archive)),
        spool_(std::move(spool)),
        pool_(options.threads),
        mapper_(std::make_unique<Mapper>(options.configuration.mapper, cart_, run_, pool_)),
        lcm_("memq://"),
        publisher_(lcm_, SubmapPublisherOptions{Channels(), std::chrono::microseconds(0)}),
        optimizer_(optimizer_options(options), *archive_),
        thread_(
            thread_options(cart_, run_), lcm_,
            [this](std::uint32_t index, const Sha256& hash) { return journal_.find(index) == hash; }, *archive_,
            optimizer_) {
    reserve_heap(options.configuration.submap_cache_bytes + options.configuration.graph_bytes + kWorkHeap_bytes);
  }

  Status process(const Scan& scan, TrajectoryFile& filter_trajectory) {
    const double cpu = thread_cpu_s();
    const Clock::time_point start = Clock::now();
    const ScanReport report = mapper_->process(scan);
    metrics_.scan_wall.add(seconds_since(start) * 1e3);
    metrics_.scan_cpu.add((thread_cpu_s() - cpu) * 1e3);
    metrics_.particles_sum += report.particles;
    metrics_.particles_max = std::max(metrics_.particles_max, report.particles);
    if (report.particles > 1) ++metrics_.scans_above_one;
    if (report.odometry_used) ++metrics_.scans_with_odometry;
    if (first_stamp_us_ == 0) first_stamp_us_ = scan.stamp_us;
    metrics_.log_s = std::max(metrics_.log_s, static_cast<double>(scan.stamp_us - first_stamp_us_) * 1e-6);
    if (next_scan_index_ != 0 && scan.index > next_scan_index_) metrics_.scans_dropped += scan.index - next_scan_index_;
    next_scan_index_ = scan.index + 1;

    const SpooledPose spooled{
        scan.stamp_us,   report.keyframe_scan_index, report.keyframe_from_base, report.keyframe_step,
        report.keyframe, report.keyframe_linked};
    if (Status status = spool_->add(spooled); !status.ok()) return status;
    if (Status status = filter_trajectory.add(scan.stamp_us, compose(map_from_odom_, report.odom_from_base));
        !status.ok()) {
      return status;
    }
    return hand_on_finished();
  }

  // Closes the run: the last sub-map, the remaining loops and the final graph.
  Expected<FinalResult> finish() {
    mapper_->finish_run();
    if (Status status = hand_on_finished(); !status.ok()) return failure(status);
    metrics_.mapper = mapper_->counters();
    metrics_.bytes = mapper_->budgets();
    mapper_.reset();  // its maps make room for the final graph and for the map that is saved
    Expected<FinalResult> result = thread_.finish();
    metrics_.optimizer = optimizer_.counters();
    const BytesUse cache = archive_->cache_bytes();
    metrics_.bytes.push_back({"submap_cache", cache.used, cache.peak, cache.limit});
    metrics_.bytes.push_back(
        {"graph", metrics_.optimizer.bytes_used, metrics_.optimizer.bytes_peak, options_.configuration.graph_bytes});
    return result;
  }

  [[nodiscard]] GraphState graph() const { return thread_.latest(); }
  [[nodiscard]] std::uint64_t submaps() const { return published_; }
  [[nodiscard]] std::uint64_t confirmed_loops() const { return thread_.back_end_counters().loops_confirmed; }
  [[nodiscard]] ReplayMetrics& metrics() { return metrics_; }
  [[nodiscard]] SubmapArchive& archive() { return *archive_; }
  [[nodiscard]] PoseSpool& spool() { return *spool_; }

 private:
  static OptimizerOptions optimizer_options(const ReplayOptions& options) {
    OptimizerOptions o;
    o.loops = options.loops;
    o.graph_bytes_limit = options.configuration.graph_bytes;
    return o;
  }
  static OptimizerThreadOptions thread_options(const Uuid& cart, const Uuid& run) {
    OptimizerThreadOptions o;
    o.cart = cart;
    o.run = run;
    o.queue_capacity = 1024;
    o.lost_after = std::chrono::milliseconds(0);
    o.lost_is_error = true;
    o.graph_pace = std::chrono::microseconds(0);
    return o;
  }

  // A finished sub-map goes to the disk, then over LCM, and the next scan waits for the optimizer's answer.
  Status hand_on_finished() {
    const std::optional<FinishedSubmap> finished = mapper_->take_finished();
    if (!finished) return {};
    const Expected<Sha256> hash = archive_->save(*finished);
    if (!hash) return hash.error();
    journal_.add(finished->id.index, *hash);
    if (Status status = publisher_.publish(*finished, *hash); !status.ok()) return status;
    if (Status status = thread_.wait_until_processed(finished->id.index); !status.ok()) return status;
    ++published_;
    // The newest optimised sub-map carries the odom frame into the map.
    const GraphState graph = thread_.latest();
    if (!graph.submaps.empty()) {
      map_from_odom_ = compose(graph.submaps.back().map_from_submap, inverse(finished->odom_from_submap));
    }
    return {};
  }

  const ReplayOptions& options_;
  Uuid cart_;
  Uuid run_;
  std::unique_ptr<SubmapArchive> archive_;
  std::unique_ptr<PoseSpool> spool_;
  ThreadPool pool_;
  std::unique_ptr<Mapper> mapper_;
  SubmapJournal journal_;
  lcm::LCM lcm_;
  SubmapPublisher publisher_;
  Optimizer optimizer_;
  OptimizerThread thread_;
  Pose2 map_from_odom_;
  std::int64_t first_stamp_us_ = 0;
  std::uint64_t next_scan_index_ = 0;
  std::uint64_t published_ = 0;
  ReplayMetrics metrics_;
};

Status prepare_folder(const std::filesystem::path& out) {
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (!error) std::filesystem::remove_all(out / "submaps", error);
  if (error) {
    return {StatusCode::kIo, fmt::format("cannot prepare the folder {}: {}", out.string(), error.message())};
  }
  return {};
}

}  // namespace

Expected<ReplayResult> replay(const ReplayOptions& options,
                              const std::function<void(const ReplayProgress&)>& progress) {
  const Clock::time_point start = Clock::now();
  Expected<Recording> recording = open_recording(options.log, options.configuration.lcm.prefix);
  if (!recording) return failure(recording.error());
  const std::unique_ptr<LogReader>& reader = recording->reader;
  if (Status status = prepare_folder(options.out); !status.ok()) return failure(status);
  Expected<std::unique_ptr<SubmapArchive>> archive =
      SubmapArchive::open(options.out / "submaps", options.configuration.submap_cache_bytes);
  if (!archive) return failure(archive.error());
  Expected<std::unique_ptr<PoseSpool>> spool = PoseSpool::create(options.out);
  if (!spool) return failure(spool.error());

  Pipeline pipeline(options, recording->origin, std::move(*archive), std::move(*spool));
  TrajectoryFile filter_trajectory(options.out / "trajectory_filter.tum");
  ReplayProgress shown;
  for (;;) {
    const Expected<std::optional<Scan>> scan = reader->next();
    if (!scan) return failure(scan.error());
    if (!scan->has_value()) break;
    if (Status status = pipeline.process(**scan, filter_trajectory); !status.ok()) return failure(status);
    if (++shown.scans % 50 == 0) {
      shown.share = reader->progress();
      shown.submaps = pipeline.submaps();
      shown.loops = pipeline.confirmed_loops();
      progress(shown);
    }
  }
  if (Status status = filter_trajectory.commit(); !status.ok()) return failure(status);
  shown.share = 1.0;
  shown.stage = "optimising";
  progress(shown);
  Expected<FinalResult> result = pipeline.finish();
  if (!result) return failure(result.error());
  shown.stage = "saving";
  progress(shown);

  ReplayMetrics& metrics = pipeline.metrics();
  metrics.log = reader->summary();
  metrics.seed = options.configuration.mapper.seed;
  const RunOutputs outputs{.folder = options.out,
                           .name = std::filesystem::path(options.log).filename().string(),
                           .subtitle = fmt::format("submapd {}, seed {}", kVersion, metrics.seed),
                           .mapper = options.configuration.mapper,
                           .raster_bytes = options.configuration.map_raster_bytes,
                           .result = *result,
                           .submaps = pipeline.archive(),
                           .poses = pipeline.spool(),
                           .scans = pipeline.spool().size(),
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
