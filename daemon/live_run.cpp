#include "daemon/live_run.hpp"

#include <fmt/format.h>

#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <exception>

#include "daemon/multicast_route.hpp"
#include "daemon/version.hpp"
#include "driver/monotonic.hpp"
#include "proto/lcm_message.hpp"

namespace submapd {
namespace {

constexpr std::size_t kReports = 160;  // four seconds
constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kDiskRate_ns = 10 * kSecond_ns;  // over which the raw log's growth is measured

std::size_t resident_bytes() {
  std::FILE* const file = std::fopen("/proc/self/statm", "re");
  if (file == nullptr) return 0;
  unsigned long all = 0;
  unsigned long resident = 0;
  const int fields = std::fscanf(file, "%lu %lu", &all, &resident);
  std::fclose(file);
  return fields == 2 ? resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) : 0;
}

}  // namespace

Expected<std::unique_ptr<LiveRun>> LiveRun::start(const Configuration& configuration) {
  Expected<RunFolder> folder = begin_run(configuration.daemon.state);
  if (!folder) return failure(folder.error());
  try {
    std::unique_ptr<LiveRun> run(new LiveRun(configuration, std::move(*folder)));
    if (Status status = run->open_files(); !status.ok()) return failure(status);
    if (Status status = run->start_threads(); !status.ok()) return failure(status);
    return run;
  } catch (const std::exception& error) {  // no memory, no threads, no descriptors
    return failure(StatusCode::kInternal, fmt::format("cannot start: {}", error.what()));
  }
}

LiveRun::LiveRun(const Configuration& configuration, RunFolder folder)
    : configuration_(configuration),
      folder_(std::move(folder)),
      mapper_bell_(make_doorbell()),
      recorder_bell_(make_doorbell()),
      publisher_bell_(make_doorbell()),
      to_publisher_(kReports, &publisher_bell_),
      to_recorder_(kReports, &recorder_bell_),
      acquisition_(configuration_, mapper_bell_, recorder_bell_),
      usb_watch_(acquisition_.heartbeat()) {}

Status LiveRun::open_files() {
  Expected<std::unique_ptr<RunJournal>> journal = RunJournal::create(folder_.journal(), folder_.cart, folder_.run);
  if (!journal) return journal.error();
  journal_ = std::move(*journal);
  if (Status status = journal_->append({folder_.clock.utime_us(), RunStarted{folder_.clock.offset_ns(), kVersion}});
      !status.ok()) {
    return status;
  }
  Expected<std::unique_ptr<SubmapArchive>> archive =
      SubmapArchive::open(folder_.submaps(), configuration_.submap_cache_bytes);
  if (!archive) return archive.error();
  archive_ = std::move(*archive);
  Expected<std::unique_ptr<PoseSpool>> poses = PoseSpool::create(folder_.path);
  if (!poses) return poses.error();
  poses_ = std::move(*poses);
  return {};
}

Status LiveRun::start_threads() {
  const Channels channels(configuration_.lcm.prefix);

  OptimizerOptions optimizer_options;
  optimizer_options.graph_bytes_limit = configuration_.graph_bytes;
  optimizer_ = std::make_unique<Optimizer>(optimizer_options, *archive_);
  OptimizerThreadOptions thread_options;
  thread_options.cart = folder_.cart;
  thread_options.run = folder_.run;
  thread_options.channels = channels;
  // Without a network it hears of sub-maps by announce() and reads them from the archive, and the publisher sends its
  // graphs as soon as there is one.
  optimizer_lcm_ = has_multicast_route(configuration_.lcm.url)
                       ? std::make_unique<lcm::LCM>(configuration_.lcm.url)
                       : std::make_unique<lcm::LCM>(static_cast<lcm_t*>(nullptr));
  optimizer_thread_ = std::make_unique<OptimizerThread>(
      thread_options, *optimizer_lcm_,
      [this](std::uint32_t index, const Sha256& hash) { return hashes_.find(index) == hash; }, *archive_, *optimizer_);

  publisher_ = std::make_unique<PublisherThread>(
      PublisherThreadOptions{configuration_.lcm.url, channels, !optimizer_lcm_->good()}, folder_.cart, folder_.run,
      to_publisher_, publisher_bell_, *optimizer_thread_);

  MapperThreadOptions mapper_options;
  mapper_options.mapper = configuration_.mapper;
  mapper_options.geometry = utm30lx_geometry();
  mapper_options.workers = configuration_.daemon.workers;
  mapper_ =
      std::make_unique<MapperThread>(mapper_options, folder_.cart, folder_.run, folder_.clock,
                                     acquisition_.mapper_ring(), mapper_bell_, pause_, to_publisher_, to_recorder_);

  recorder_ =
      std::make_unique<RecorderThread>(configuration_, folder_,
                                       RecorderLinks{{&acquisition_.recorder_ring(driver::SensorRole::kHorizontal),
                                                      &acquisition_.recorder_ring(driver::SensorRole::kVertical)},
                                                     to_recorder_,
                                                     pause_,
                                                     recorder_bell_,
                                                     *mapper_,
                                                     *archive_,
                                                     hashes_,
                                                     *journal_,
                                                     *poses_,
                                                     *publisher_,
                                                     *optimizer_thread_});
  saver_ = std::make_unique<MapSaver>(configuration_, folder_,
                                      SaverLinks{*mapper_, *recorder_, *optimizer_thread_, *poses_});
  watches_ = {HeartbeatWatch(mapper_->heartbeat()), HeartbeatWatch(recorder_->heartbeat()),
              HeartbeatWatch(publisher_->heartbeat())};

  if (Status status = acquisition_.start(); !status.ok()) return status;
  for (const Status* const priority : {&acquisition_.priority(), &mapper_->priority()}) {
    if (!priority->ok()) remarks_.push_back(priority->message());
  }
  return {};
}

LiveRun::~LiveRun() {
  saver_.reset();
  acquisition_.stop();
  if (mapper_ != nullptr && recorder_ != nullptr) mapper_->finish();
  recorder_.reset();   // takes the last sub-map
  publisher_.reset();  // sends it
}

Health LiveRun::look() {
  Health health;
  health.utime_us = folder_.clock.utime_us();
  health.run = folder_.name;
  health.cart_id = folder_.cart;
  health.run_id = folder_.run;
  health.mapper = mapper_->state();
  health.recorder = recorder_->state();
  health.publisher = publisher_->state();
  look_at_rates(health);
  look_at_scanners(health);
  health.optimizer = optimizer_thread_->back_end_counters();
  health.optimizer_thread = optimizer_thread_->counters();
  health.graph_version = optimizer_thread_->version();
  health.optimizer_trouble = optimizer_thread_->status().message();
  health.save = saver_->progress();
  health.paused = pause_.paused();
  health.rss_bytes = resident_bytes();
  health.budget_bytes =
      mapper_->bytes_limit() + configuration_.submap_cache_bytes + configuration_.graph_bytes +
      configuration_.map_raster_bytes +
      static_cast<std::size_t>(configuration_.daemon.mapper_ring + 2 * configuration_.daemon.recorder_ring) *
          sizeof(driver::DeviceScan);
  return health;
}

void LiveRun::look_at_rates(Health& health) {
  const std::int64_t now_ns = driver::monotonic_now_ns();
  // look_at_scanners() begins the second.
  if (now_ns - second_began_ns_ >= kSecond_ns) {
    const double since_s = static_cast<double>(now_ns - second_began_ns_) * 1e-9;
    pose_hz_ = static_cast<double>(health.publisher.poses - poses_then_) / since_s;
    poses_then_ = health.publisher.poses;
  }
  health.pose_hz = pose_hz_;
  if (now_ns - raw_since_ns_ >= kDiskRate_ns) {
    if (raw_since_ns_ > 0) {
      raw_bytes_s_ = static_cast<double>(health.recorder.raw_bytes - raw_then_) * 1e9 /
                     static_cast<double>(now_ns - raw_since_ns_);
    }
    raw_since_ns_ = now_ns;
    raw_then_ = health.recorder.raw_bytes;
  }
  const double left = static_cast<double>(health.recorder.disk_free_bytes) -
                      static_cast<double>(configuration_.recorder.disk_last_bytes);
  if (raw_bytes_s_ > 0.0) health.disk_minutes = std::max(0.0, left) / raw_bytes_s_ / 60.0;
}

void LiveRun::look_at_scanners(Health& health) {
  const std::vector<driver::ScannerInfo> present = acquisition_.scanners();
  const std::int64_t now_ns = driver::monotonic_now_ns();
  const double since_s = static_cast<double>(now_ns - second_began_ns_) * 1e-9;
  const bool second_over = now_ns - second_began_ns_ >= kSecond_ns;
  if (second_over) second_began_ns_ = now_ns;
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const auto role = static_cast<driver::SensorRole>(i);
    const driver::RoleRule& rule = configuration_.scanner.roles[i];
    const driver::ScanRing& ring = acquisition_.recorder_ring(role);
    ScannerHealth& scanner = health.scanners[i];
    Seen& seen = seen_[i];
    scanner.configured = !rule.serial.empty() || !rule.port.empty();
    scanner.serial = rule.serial.empty() ? "at port " + rule.port : rule.serial;
    for (const driver::ScannerInfo& info : present) {
      const bool ours =
          info.role == role ||
          (!info.role && ((!rule.serial.empty() && driver::same_serial(rule.serial, info.status.identity.serial)) ||
                          (rule.serial.empty() && rule.port == info.port.path)));
      if (!ours || !scanner.configured) continue;
      scanner.present = true;
      scanner.state = info.status.state;
      scanner.words = info.status.words;
      scanner.bad_frames = info.counters.faults;
    }
    const bool streaming = scanner.present && scanner.state == driver::SensorState::kStreaming;
    if (streaming && !seen.streaming) ++seen.connects;
    seen.streaming = streaming;
    scanner.reconnects = seen.connects > 0 ? seen.connects - 1 : 0;
    scanner.dropped = ring.dropped();
    scanner.scans = ring.published() + ring.dropped();
    if (second_over) {
      seen.rate_hz = static_cast<double>(scanner.scans - seen.scans) / since_s;
      seen.scans = scanner.scans;
    }
    scanner.rate_hz = seen.rate_hz;
    scanner.clock_error_ms = 1e-6 * static_cast<double>(health.recorder.clock_error_ns[i]);
  }
}

void LiveRun::publish(const Health& health) {
  publisher_->post(Channels(configuration_.lcm.prefix).health, encode_message(message_of(health)));
}

Status LiveRun::pause() {
  if (pause_.paused()) return {};
  if (!recorder_->note(RunPaused{})) return {StatusCode::kUnavailable, "the disk does not keep up; try again"};
  pause_.pause(driver::monotonic_now_ns());
  return {};
}

Status LiveRun::resume() {
  if (!pause_.paused()) return {};
  if (!recorder_->note(RunResumed{})) return {StatusCode::kUnavailable, "the disk does not keep up; try again"};
  pause_.resume(driver::monotonic_now_ns());
  return {};
}

bool LiveRun::all_moved() {
  bool moved = usb_watch_.moved();
  if (!moved) {
    moved = true;
    for (const driver::ScannerInfo& scanner : acquisition_.scanners()) {
      // An open line always has a deadline that wakes the thread within a second or so.
      if (scanner.status.state == driver::SensorState::kStreaming) moved = false;
    }
  }
  for (const HeartbeatWatch& watch : watches_) moved = moved && watch.moved();
  if (!moved) return false;
  usb_watch_.note();
  for (HeartbeatWatch& watch : watches_) watch.note();
  return true;
}

}  // namespace submapd
