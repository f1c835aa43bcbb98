#include "daemon/live_run.hpp"

#include <fmt/format.h>

#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <exception>

#include "daemon/allocator.hpp"
#include "daemon/daemon_log.hpp"
#include "daemon/multicast_route.hpp"
#include "daemon/version.hpp"
#include "driver/monotonic.hpp"
#include "proto/lcm_message.hpp"

namespace submapd {
namespace {

constexpr std::size_t kReports = 160;                     // four seconds
constexpr std::int64_t kDiskRate_ns = 10 * kSecond_ns;    // over which the raw log's growth is measured
constexpr std::int64_t kAfterLast_us = 1'000'000;         // a run goes on at least this long after its newest scan
constexpr std::chrono::milliseconds kSavePatience{5000};  // at the end of a run
// Scans that may wait when their source can: few for the mapper, a second's for the recorder.
constexpr std::uint64_t kWaiting = 4;
constexpr std::uint64_t kUnwritten = 40;

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

Expected<std::unique_ptr<LiveRun>> LiveRun::start(const Configuration& configuration, const std::string& input) {
  try {
    std::unique_ptr<LiveRun> run(new LiveRun(configuration));
    if (Status status = run->choose_run(input); !status.ok()) return failure(status);
    if (Status status = run->open_files(); !status.ok()) {
      if (!run->resume_) discard_run(run->folder_);  // nothing is in it
      return failure(status);
    }
    if (Status status = run->start_threads(); !status.ok()) return failure(status);
    reserve_heap(configuration.submap_cache_bytes + configuration.graph_bytes +
                 work_heap_bytes(configuration.graph_bytes));
    return run;
  } catch (const std::exception& error) {  // no memory, no threads, no descriptors
    return failure(StatusCode::kInternal, fmt::format("cannot start: {}", error.what()));
  }
}

LiveRun::LiveRun(const Configuration& configuration)
    : configuration_(configuration),
      mapper_bell_(make_doorbell()),
      recorder_bell_(make_doorbell()),
      publisher_bell_(make_doorbell()),
      input_bell_(make_doorbell()),
      room_(input_bell_),
      to_publisher_(kReports, &publisher_bell_),
      to_recorder_(kReports, &recorder_bell_),
      clock_watch_(RunClock::system_offset_ns()) {}

Status LiveRun::choose_run(const std::string& input) {
  Expected<std::unique_ptr<ScanInput>> made = make_input(input, configuration_, mapper_bell_, recorder_bell_);
  if (!made) return made.error();
  input_ = std::move(*made);
  Expected<UnfinishedRun> unfinished = find_unfinished_run(configuration_, input_->kind());
  if (unfinished) {
    folder_ = std::move(unfinished->folder);
    resume_ = std::move(unfinished->point);
    const std::int64_t last_us = *std::max_element(resume_->last_stamp_us.begin(), resume_->last_stamp_us.end());
    folder_.clock = input_->clock(last_us + kAfterLast_us);
    input_->skip_until(resume_->last_stamp_us);
    marks_ = resume_->marks;
    remarks_.push_back(
        fmt::format("run {} was cut off and goes on, with {} finished sub-maps", folder_.name, resume_->hashes.size()));
    return {};
  }
  if (unfinished.error().code() != StatusCode::kNotFound) {
    remarks_.push_back(unfinished.error().message() + "; it stays as it is and a new run begins");
  }
  Expected<RunFolder> folder = begin_run(configuration_.daemon.state, input_->clock(std::nullopt));
  if (!folder) return folder.error();
  folder_ = std::move(*folder);
  return {};
}

Status LiveRun::open_files() {
  Expected<std::unique_ptr<RunJournal>> journal =
      resume_ ? RunJournal::reopen(folder_.journal(), resume_->journal)
              : RunJournal::create(folder_.journal(), folder_.cart, folder_.run);
  if (!journal) return journal.error();
  journal_ = std::move(*journal);
  std::vector<JournalEvent> first;
  if (resume_) {
    first.emplace_back(RunContinued{folder_.clock.offset_ns(), kVersion});
    for (std::size_t i = resume_->hashes.size() - resume_->adopted; i < resume_->hashes.size(); ++i) {
      first.emplace_back(SubmapSaved{static_cast<std::uint32_t>(i), resume_->hashes[i]});
    }
    for (std::uint32_t i = 0; i < resume_->hashes.size(); ++i) hashes_.add(i, resume_->hashes[i]);
  } else {
    first = {RunStarted{folder_.clock.offset_ns(), kVersion}, InputIs{input_->kind()}};
  }
  for (JournalEvent& event : first) {
    if (Status status = journal_->append({folder_.clock.utime_us(), std::move(event)}); !status.ok()) return status;
  }
  Expected<std::unique_ptr<SubmapArchive>> archive =
      SubmapArchive::open(folder_.submaps(), configuration_.submap_cache_bytes);
  if (!archive) return archive.error();
  archive_ = std::move(*archive);
  Expected<std::unique_ptr<PoseSpool>> poses = PoseSpool::open(folder_.poses());
  if (!poses) return poses.error();
  poses_ = std::move(*poses);
  return resume_ ? go_on_with_poses() : Status();
}

Status LiveRun::go_on_with_poses() {
  const std::int64_t until_us = resume_->mapped_until_us();
  Expected<std::vector<Standstill>> standstills = find_standstills(*poses_, until_us);  // before they are cut away
  if (!standstills) return standstills.error();
  resume_->standstills = std::move(*standstills);
  if (Status status = poses_->keep_until(until_us); !status.ok()) return status;
  return resume_->last ? add_missing_poses() : Status();
}

// The newest poses may not have reached the disk: key-frames tell theirs.
Status LiveRun::add_missing_poses() {
  const Keyframe* before = nullptr;
  for (const Keyframe& k : resume_->last->keyframes) {
    if (k.stamp_us > poses_->last_stamp_us()) {
      const Pose2 step = before != nullptr ? between(before->pose, k.pose) : Pose2{};
      if (Status status = poses_->add({k.stamp_us, k.scan_index, {}, step, true, before != nullptr}); !status.ok()) {
        return status;
      }
    }
    before = &k;
  }
  poses_before_ = poses_->size();
  return {};
}

void LiveRun::start_optimizer(const Channels& channels) {
  OptimizerOptions optimizer_options;
  optimizer_options.parts = configuration_.graph_parts;
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
}

void LiveRun::start_mapper() {
  MapperThreadOptions options;
  options.mapper = configuration_.mapper;
  options.geometry = input_->geometry();
  options.workers = configuration_.daemon.workers;
  options.slow_ms = configuration_.daemon.slow_mapper_ms;
  options.real_time = input_->kind() != "file";  // which never rests
  if (resume_) {
    options.resumed = true;
    options.last = resume_->last;
    const std::optional<std::uint64_t> after =
        resume_->last ? std::optional(resume_->last->keyframes.back().scan_index) : std::nullopt;
    options.standstills = resume_->standstills;
    options.backlog = scans_after(*resume_, folder_.run, Channels(configuration_.lcm.prefix), after);
    options.first_index = resume_->next_index[0];
    options.after_us = resume_->last_stamp_us[0];
  }
  mapper_ = std::make_unique<MapperThread>(options, folder_.cart, folder_.run, folder_.clock, input_->mapper_ring(),
                                           mapper_bell_, room_, pause_, to_publisher_, to_recorder_);
}

Status LiveRun::start_threads() {
  const Channels channels(configuration_.lcm.prefix);
  start_optimizer(channels);
  publisher_ = std::make_unique<PublisherThread>(
      PublisherThreadOptions{configuration_.lcm.url, channels, !optimizer_lcm_->good()}, folder_.cart, folder_.run,
      folder_.clock, to_publisher_, publisher_bell_, room_, *optimizer_thread_);
  RecorderStart start;
  if (resume_) {
    start.raw_file = resume_->next_raw_file;
    start.index = resume_->next_index;
    start.after_us = resume_->last_stamp_us;
    start.last_submap = static_cast<std::int64_t>(resume_->hashes.size()) - 1;
    if (resume_->last) {
      // Its place in the odometry's frame carries poses into the map.
      publisher_->hand_over(resume_->last, resume_->hashes.back());
      optimizer_thread_->announce(resume_->last->id.index);
    }
  }
  start_mapper();
  Configuration recording = configuration_;
  if (input_->kind() == "lcm") recording.lcm.scan_every = 0;  // they are there already
  recorder_ = std::make_unique<RecorderThread>(recording, folder_, input_->geometry(), start,
                                               RecorderLinks{{&input_->recorder_ring(driver::SensorRole::kHorizontal),
                                                              &input_->recorder_ring(driver::SensorRole::kVertical)},
                                                             to_recorder_,
                                                             pause_,
                                                             recorder_bell_,
                                                             room_,
                                                             *mapper_,
                                                             *archive_,
                                                             hashes_,
                                                             *journal_,
                                                             *poses_,
                                                             *publisher_,
                                                             *optimizer_thread_});
  saver_ = std::make_unique<MapSaver>(configuration_, folder_,
                                      SaverLinks{*mapper_, *recorder_, *optimizer_thread_, *poses_, poses_before_});
  watches_ = {HeartbeatWatch(mapper_->heartbeat()), HeartbeatWatch(recorder_->heartbeat()),
              HeartbeatWatch(publisher_->heartbeat())};
  input_watch_.emplace(input_->heartbeat());
  resume_.reset();

  const auto has_room = [this] {
    return input_->mapper_ring().size() < kWaiting && !mapper_->has_finished() &&
           input_->recorder_ring(driver::SensorRole::kHorizontal).size() < kUnwritten &&
           input_->recorder_ring(driver::SensorRole::kVertical).size() < kUnwritten &&
           to_recorder_.size() < kReports / 2 && to_publisher_.size() < kReports / 2;
  };
  input_->wait_for(has_room, room_);
  join_odometry();
  if (Status status = input_->start(); !status.ok()) return status;
  for (const Status* const priority : {&input_->priority(), &mapper_->priority()}) {
    if (!priority->ok()) remarks_.push_back(priority->message());
  }
  return {};
}

void LiveRun::join_odometry() {
  if (!configuration_.lcm.odometry) return;
  odometry_ = std::make_unique<OdometryInput>(configuration_.lcm, folder_.cart);
  if (input_->join_with(odometry_->track())) return;
  odometry_.reset();
  remarks_.emplace_back("odometry comes with the scans; messages with odometry are not listened to");
}

LiveRun::~LiveRun() {
  if (input_ != nullptr) input_->stop();
  if (mapper_ != nullptr && recorder_ != nullptr) {
    if (!mapper_->finish()) recorder_->leave_open();
    recorder_->finish();  // takes the last sub-map
  }
  // All is on the disk. A map that is just being saved gets some time, a search for loops none.
  if (saver_ != nullptr) (void)saver_->wait_until_idle(kSavePatience);
  if (optimizer_ != nullptr) optimizer_->cancel();
  saver_.reset();
  recorder_.reset();
  publisher_.reset();  // sends the last sub-map
}

Health LiveRun::look() {
  Health health;
  health.utime_us = folder_.clock.utime_us();
  health.run = folder_.name;
  health.cart_id = folder_.cart;
  health.run_id = folder_.run;
  health.input = input_->kind();
  health.input_ended = input_->ended();
  health.input_trouble = input_->trouble();
  look_at_clock();
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
  if (odometry_ != nullptr) health.odometry = odometry_->counters();
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

void LiveRun::look_at_clock() {
  const std::optional<std::int64_t> step_ns = clock_watch_.look(RunClock::system_offset_ns());
  if (!step_ns) return;
  log(Severity::kWarning, fmt::format("the system's clock was set {:+.1f} s; stamps of this run do not follow",
                                      static_cast<double>(*step_ns) * 1e-9));
  (void)recorder_->note(ClockStepped{*step_ns});
}

void LiveRun::look_at_scanners(Health& health) {
  const std::vector<driver::ScannerInfo> present = input_->scanners();
  const std::int64_t now_ns = driver::monotonic_now_ns();
  const double since_s = static_cast<double>(now_ns - second_began_ns_) * 1e-9;
  const bool second_over = now_ns - second_began_ns_ >= kSecond_ns;
  if (second_over) second_began_ns_ = now_ns;
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const auto role = static_cast<driver::SensorRole>(i);
    const driver::RoleRule& rule = configuration_.scanner.roles[i];
    const driver::ScanRing& ring = input_->recorder_ring(role);
    ScannerHealth& scanner = health.scanners[i];
    Seen& seen = seen_[i];
    if (input_->kind() != "usb") {
      scanner.configured = scanner.present = role == driver::SensorRole::kHorizontal || ring.published() > 0;
      scanner.state = driver::SensorState::kStreaming;
      scanner.serial = input_->kind();
    } else {
      scanner.configured = !rule.serial.empty() || !rule.port.empty();
      scanner.serial = rule.serial.empty() ? "at port " + rule.port : rule.serial;
    }
    for (const driver::ScannerInfo& info : present) {
      const bool ours =
          info.role == role ||
          (!info.role && ((!rule.serial.empty() && driver::same_serial(rule.serial, info.status.identity.serial)) ||
                          (rule.serial.empty() && rule.port == info.port.path)));
      if (!scanner.configured) continue;
      if (!ours) {
        // One that cannot be opened has not told its serial number: it may be the one that is missed.
        if (!scanner.present && info.status.state == driver::SensorState::kClosed && !info.status.words.empty()) {
          scanner.words = fmt::format("at port {}: {}", info.port.path, info.status.words);
        }
        continue;
      }
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

void LiveRun::publish(const LcmCommand& command, const ControlReply& reply) {
  publisher_->post(Channels(configuration_.lcm.prefix).reply,
                   encode_command_reply(command, reply, folder_.cart, folder_.run, folder_.clock.utime_us()));
}

Status LiveRun::pause() {
  if (pause_.paused()) return {};
  if (!recorder_->note(RunPaused{})) return {StatusCode::kUnavailable, "the disk does not keep up; try again"};
  pause_.pause(folder_.clock.now_ns());
  return {};
}

Status LiveRun::resume() {
  if (!pause_.paused()) return {};
  if (!recorder_->note(RunResumed{})) return {StatusCode::kUnavailable, "the disk does not keep up; try again"};
  pause_.resume(folder_.clock.now_ns());
  return {};
}

bool LiveRun::all_moved() {
  bool moved = input_watch_->moved() || !input_->must_move();
  for (const HeartbeatWatch& watch : watches_) moved = moved && watch.moved();
  if (!moved) return false;
  input_watch_->note();
  for (HeartbeatWatch& watch : watches_) watch.note();
  return true;
}

}  // namespace submapd
