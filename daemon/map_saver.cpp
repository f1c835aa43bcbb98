#include "daemon/map_saver.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <exception>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "daemon/map_folder.hpp"
#include "daemon/map_report.hpp"
#include "daemon/realtime.hpp"
#include "daemon/recorded_scans.hpp"
#include "daemon/version.hpp"
#include "driver/monotonic.hpp"
#include "proto/channels.hpp"
#include "slam/base/atomic_file.hpp"
#include "slam/output/point_cloud.hpp"
#include "slam/submap/submap_archive.hpp"
#include "slam/submap/with_open_submap.hpp"

namespace submapd {
namespace {

constexpr const char* kPicture = "live.png";
constexpr int kTries = 3;                         // the open sub-map may close while the graph is prepared
constexpr std::uint64_t kRoom_bytes = 64U << 20;  // less room on the disk is not worth a try
constexpr std::chrono::seconds kRecorderPatience{10};

Status ends() {
  return {StatusCode::kUnavailable, "the daemon ends"};
}

// What a map takes long over is read piece by piece: at its end the daemon gives no more.
class SubmapsUntil final : public SubmapSource {
 public:
  SubmapsUntil(const std::atomic<bool>& stop, SubmapSource& source) : stop_(stop), source_(source) {}
  Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) override {
    if (stop_.load()) return failure(ends());
    return source_.load(index);
  }

 private:
  const std::atomic<bool>& stop_;
  SubmapSource& source_;
};

class ScansUntil final : public CloudScans {
 public:
  ScansUntil(const std::atomic<bool>& stop, std::unique_ptr<CloudScans> scans)
      : stop_(stop), scans_(std::move(scans)) {}
  Expected<std::optional<CloudScan>> next() override {
    if (stop_.load()) return failure(ends());
    return scans_->next();
  }

 private:
  const std::atomic<bool>& stop_;
  const std::unique_ptr<CloudScans> scans_;
};

}  // namespace

MapSaver::MapSaver(const Configuration& configuration, const RunFolder& run, const SaverLinks& links)
    : configuration_(configuration), folder_(run), links_(links), mount_(configuration.scanner.vertical_mount) {
  thread_ = std::thread([this] { this->run(); });
}

MapSaver::~MapSaver() {
  {
    const MutexLock lock(mutex_);
    stop_.store(true);
  }
  wanted_.notify_all();
  thread_.join();
}

Expected<SaveProgress> MapSaver::start(SaveRequest request) {
  if (request.name.empty()) {
    request.name = fmt::format("map-{:%Y%m%d-%H%M%S}", fmt::gmtime(std::time_t{folder_.clock.utime_us() / 1'000'000}));
  }
  const MutexLock lock(mutex_);
  if (!request.id.empty() && request.id == progress_.id) return progress_;
  if (progress_.state == SaveState::kWorking) {
    return failure(StatusCode::kUnavailable, fmt::format("the map {} is being saved, {} % done; try again then",
                                                         progress_.name, progress_.percent));
  }
  if (!is_name(request.name)) {
    return failure(StatusCode::kInvalidArgument, fmt::format("\"{}\" is no name for a map", request.name));
  }
  progress_ = {};
  progress_.state = SaveState::kWorking;
  progress_.id = request.id;
  progress_.name = request.name;
  progress_.picture_only = request.picture_only;
  request_ = std::move(request);
  wanted_.notify_all();
  return progress_;
}

SaveProgress MapSaver::progress() const {
  const MutexLock lock(mutex_);
  return progress_;
}

void MapSaver::set_mount(const ScannerMount& mount) {
  const MutexLock lock(mutex_);
  mount_ = mount;
}

void MapSaver::tell(int percent) {
  const MutexLock lock(mutex_);
  progress_.percent = percent;
}

void MapSaver::run() {
  name_thread("saver");
  for (;;) {
    SaveRequest request;
    {
      const MutexLock lock(mutex_);
      while (!request_ && !stop_.load()) wanted_.wait(mutex_);
      if (!request_) return;
      request = *std::exchange(request_, std::nullopt);
    }
    Status status;
    try {
      status = request.picture_only ? draw() : save(request);
    } catch (const std::exception& error) {  // no memory
      status = Status(StatusCode::kInternal, error.what());
    }
    const MutexLock lock(mutex_);
    progress_.state = status.ok() ? SaveState::kDone : SaveState::kFailed;
    progress_.percent = status.ok() ? 100 : progress_.percent;
    const std::filesystem::path path = request.picture_only ? folder_.path / kPicture : folder_.maps() / request.name;
    progress_.path = status.ok() ? path.string() : "";
    progress_.ended_ns = driver::monotonic_now_ns();
    progress_.status = std::move(status);
    idle_.notify_all();
  }
}

Status MapSaver::wait_for_recorder(const OpenRun& run) {
  const std::int64_t before = std::int64_t{run.open->id.index} - 1;
  if (links_.recorder.wait_until(run.reports, before, kRecorderPatience)) return {};
  const std::string trouble = links_.recorder.state().trouble;
  return {StatusCode::kUnavailable, "the disk does not keep up" + (trouble.empty() ? trouble : ": " + trouble)};
}

bool MapSaver::wait_until_idle(std::chrono::milliseconds patience) {
  const auto end = std::chrono::steady_clock::now() + patience;
  const MutexLock lock(mutex_);
  while (progress_.state == SaveState::kWorking) {
    if (idle_.wait_until(mutex_, end) == std::cv_status::timeout) return false;
  }
  return true;
}

Expected<OpenRun> MapSaver::look() {
  Expected<OpenRun> run = links_.mapper.snapshot();
  if (!run) return failure(run.error());
  if (!run->open) {
    return failure(StatusCode::kUnavailable, "there is no map yet: no scan of the horizontal scanner has come");
  }
  if (Status status = wait_for_recorder(*run); !status.ok()) return failure(status);
  tell(10);
  return run;
}

// Sub-maps where the live graph has them; what is newer follows by the filter's own way.
Status MapSaver::draw() {
  Expected<OpenRun> run = look();
  if (!run) return run.error();
  Expected<std::unique_ptr<SubmapArchive>> archive = SubmapArchive::open(folder_.submaps(), 0);
  if (!archive) return archive.error();
  const auto open = std::make_shared<const FinishedSubmap>(std::move(*run->open));
  WithOpenSubmap all(**archive, open);
  SubmapsUntil submaps(stop_, all);
  const GraphState graph = links_.optimizer.latest();
  const Expected<FinalResult> live = live_result(graph, open->id.index, submaps);
  if (!live) return live.error();
  tell(30);
  return draw_live_map(folder_.path / kPicture, fmt::format("submapd {}, run {}, live", kVersion, folder_.name), *live,
                       submaps, configuration_.mapper, configuration_.map_raster_bytes);
}

Expected<MapSaver::Solved> MapSaver::solve() {
  Status last;
  for (int i = 0; i < kTries; ++i) {
    Expected<OpenRun> run = look();
    if (!run) return failure(run.error());
    auto open = std::make_shared<const FinishedSubmap>(std::move(*run->open));
    Expected<FinalResult> result = links_.optimizer.finish_with(open);
    if (result) return Solved{std::move(*run), std::move(open), std::move(*result)};
    last = result.error();
    if (last.code() != StatusCode::kInvalidArgument) break;  // else the sub-map has been closed meanwhile
  }
  return failure(last);
}

OpenCloudScans MapSaver::vertical_scans() const {
  return [this]() -> Expected<std::unique_ptr<CloudScans>> {
    auto scans = open_recorded_scans(folder_.path, Channels(configuration_.lcm.prefix), driver::SensorRole::kVertical);
    if (!scans) return scans;
    return std::make_unique<ScansUntil>(stop_, std::move(*scans));
  };
}

Expected<CloudSize> MapSaver::size_cloud(const OptimizedTrajectory& trajectory, const ScannerMount& mount) {
  Expected<CloudSize> size = measure_cloud(trajectory, mount, vertical_scans());
  if (!size) return size;
  if (size->points == 0) {
    return failure(StatusCode::kUnavailable,
                   "there is nothing for a cloud: no scans of the vertical scanner are recorded yet; is it plugged in, "
                   "named by [scanner] vertical, and [recorder] raw on?");
  }
  // A cloud may be left out; recording may not be stopped by it.
  const std::uint64_t kept = std::max<std::uint64_t>(kRoom_bytes, configuration_.recorder.disk_last_bytes);
  const std::uint64_t free = links_.recorder.state().disk_free_bytes;
  if (free < kept + size->bytes()) {
    return failure(StatusCode::kIo,
                   fmt::format("cloud.ply would take {} MB, and of the {} MB left on the disk {} are kept for the run; "
                               "make room, or save without the cloud",
                               (size->bytes() >> 20) + 1, free >> 20, kept >> 20));
  }
  const MutexLock lock(mutex_);
  progress_.cloud_bytes = size->bytes();
  return size;
}

Status MapSaver::write_report(const std::filesystem::path& path, const std::string& name, const Solved& solved,
                              const RunOutputsSummary& written) const {
  nlohmann::json report = quality_report(written.quality, solved.result);
  const MapperState mapper = links_.mapper.state();
  report["name"] = name;
  report["run"] = folder_.name;
  report["version"] = kVersion;
  report["path_m"] = written.path_m;
  report["scans"] = {{"mapped", mapper.scans},
                     {"not_mapped", mapper.skipped},
                     {"missing", mapper.missing},
                     {"fitted_nowhere", mapper.lost}};
  const std::string text = report.dump(2) + "\n";
  return atomic_write_file(path, std::as_bytes(std::span(text)));
}

Status MapSaver::save(const SaveRequest& request) {
  const RecorderState recorder = links_.recorder.state();
  if (recorder.disk_free_bytes < kRoom_bytes) {
    return {StatusCode::kIo, fmt::format("only {} MB are left on the disk of {}; make room",
                                         recorder.disk_free_bytes >> 20, folder_.maps().string())};
  }
  Expected<MapFolder> folder = MapFolder::begin(folder_.maps(), request.name, request.force);
  if (!folder) return folder.error();
  Expected<Solved> solved = solve();
  if (!solved) return solved.error();
  tell(60);
  // A reader of its own: the optimizer's cache belongs to its thread.
  Expected<std::unique_ptr<SubmapArchive>> archive = SubmapArchive::open(folder_.submaps(), 0);
  if (!archive) return archive.error();
  const std::uint64_t failed = links_.recorder.state().poses_failed;  // are not in the spool
  const std::uint64_t scans = links_.poses_before + solved->run.reports - std::min(solved->run.reports, failed);
  const Expected<OptimizedTrajectory> trajectory = OptimizedTrajectory::make(solved->result, links_.poses, scans);
  if (!trajectory) return trajectory.error();
  CloudSize cloud;
  ScannerMount mount;
  if (request.cloud) {
    {
      const MutexLock lock(mutex_);
      mount = mount_;
    }
    const Expected<CloudSize> size = size_cloud(*trajectory, mount);
    if (!size) return size.error();
    cloud = *size;
  }
  tell(65);
  WithOpenSubmap all(**archive, solved->open);
  SubmapsUntil submaps(stop_, all);
  const RunOutputs outputs{.folder = folder->aside(),
                           .name = request.name,
                           .subtitle = fmt::format("submapd {}, run {}", kVersion, folder_.name),
                           .mapper = configuration_.mapper,
                           .raster_bytes = configuration_.map_raster_bytes,
                           .result = solved->result,
                           .submaps = submaps,
                           .poses = links_.poses,
                           .scans = scans,
                           .marks = request.marks};
  const Expected<RunOutputsSummary> written = write_run_outputs(outputs);
  if (!written) return written.error();
  if (request.cloud) {
    tell(80);
    if (Status status = write_cloud(folder->aside() / "cloud.ply", cloud, *trajectory, mount, vertical_scans(),
                                    [this](double share) { tell(80 + static_cast<int>(15.0 * share)); });
        !status.ok()) {
      return status;
    }
  }
  if (Status status = write_report(folder->aside() / "report.json", request.name, *solved, *written); !status.ok()) {
    return status;
  }
  tell(95);
  const auto confirmed = std::count_if(solved->result.loops.begin(), solved->result.loops.end(),
                                       [](const Loop& loop) { return loop.state == LoopState::kConfirmed; });
  const Status status = folder->commit({{"format", 1},
                                        {"version", kVersion},
                                        {"name", request.name},
                                        {"run", folder_.name},
                                        {"run_id", folder_.run.to_string()},
                                        {"cart", folder_.cart.to_string()},
                                        {"saved_utime_us", folder_.clock.utime_us()},
                                        {"last_scan_utime_us", solved->open->keyframes.back().stamp_us},
                                        {"scans", outputs.scans},
                                        {"submaps", solved->result.submaps.size()},
                                        {"path_m", written->path_m},
                                        {"cell_m", written->cell_m},
                                        {"cloud_points", cloud.points},
                                        {"loops_confirmed", confirmed}});
  if (status.ok()) (void)links_.recorder.note(MapSaved{request.name});
  return status;
}

}  // namespace submapd
