#include "daemon/recorder_thread.hpp"

#include <fmt/format.h>
#include <sys/statvfs.h>

#include <chrono>
#include <utility>

#include "daemon/daemon_log.hpp"
#include "daemon/realtime.hpp"
#include "driver/monotonic.hpp"
#include "proto/scan_conversion.hpp"
#include "slam/submap/submap_check.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kSync_ns = kSecond_ns / 2;
constexpr std::int64_t kTroubleLasts_ns = 5 * kSecond_ns;  // after the last refusal
constexpr std::chrono::milliseconds kIdle{100};
constexpr std::size_t kMostNotes = 64;

}  // namespace

RecorderThread::RecorderThread(const Configuration& configuration, const RunFolder& run, const ScanGeometry& geometry,
                               const RecorderStart& start, const RecorderLinks& links)
    : options_(configuration.recorder),
      channels_(configuration.lcm.prefix),
      scan_every_(static_cast<std::uint64_t>(configuration.lcm.scan_every)),
      folder_(run),
      links_(links),
      raw_(run.path, configuration.recorder.raw_file_bytes, start.raw_file),
      stampers_{ScanStamper(run.clock, geometry, start.index[0], start.after_us[0]),
                ScanStamper(run.clock, geometry, start.index[1], start.after_us[1])},
      last_submap_(start.last_submap) {
  thread_ = std::thread([this] { this->run(); });
}

RecorderThread::~RecorderThread() {
  finish();
}

void RecorderThread::finish() {
  if (!thread_.joinable()) return;
  stop_.store(true);
  links_.bell.ring();
  thread_.join();
}

bool RecorderThread::wait_until(std::uint64_t reports, std::int64_t submap, std::chrono::milliseconds patience) {
  const auto end = std::chrono::steady_clock::now() + patience;
  waiting_.fetch_add(1);
  const MutexLock lock(mutex_);
  bool written = false;
  for (bool timed_out = false;;) {
    written = reports_.load() >= reports && last_submap_.load() >= submap;
    if (written || timed_out || ended_) break;
    timed_out = written_.wait_until(mutex_, end) == std::cv_status::timeout;
  }
  waiting_.fetch_sub(1);
  return written;
}

bool RecorderThread::note(JournalEvent event) {
  {
    const MutexLock lock(mutex_);
    if (notes_.size() >= kMostNotes) return false;
    notes_.push_back(std::move(event));
  }
  noted_.store(true);
  links_.bell.ring();
  return true;
}

RecorderState RecorderThread::state() const {
  RecorderState state;
  state.raw_scans = raw_scans_.load();
  state.raw_lost = raw_lost_.load();
  state.last_submap = last_submap_.load();
  state.reports = reports_.load();
  state.poses_failed = poses_failed_.load();
  state.disk_free_bytes = disk_free_.load();
  state.raw_bytes = raw_bytes_.load();
  for (std::size_t i = 0; i < clock_error_ns_.size(); ++i) state.clock_error_ns[i] = clock_error_ns_[i].load();
  state.disk = disk_.load();
  const MutexLock lock(mutex_);
  if (driver::monotonic_now_ns() - trouble_ns_ < kTroubleLasts_ns) state.trouble = trouble_;
  return state;
}

void RecorderThread::run() {
  name_thread("recorder");
  const auto something = [this] {
    return links_.scans[0]->has_data() || links_.scans[1]->has_data() || links_.reports.has_data() || noted_.load() ||
           stop_.load();
  };
  for (;;) {
    links_.bell.wait(something, kIdle);
    heartbeat_.beat();
    const bool stop = stop_.load();
    write_scans();
    write_poses();
    while (write_submap() && stop) {
    }
    write_notes();
    if (waiting_.load() > 0) {
      const MutexLock lock(mutex_);
      written_.notify_all();
    }
    const std::int64_t now_ns = driver::monotonic_now_ns();
    if (now_ns >= next_second_ns_) {
      next_second_ns_ = now_ns + kSecond_ns;
      each_second();
    }
    if (stop || now_ns >= next_sync_ns_) {
      next_sync_ns_ = now_ns + kSync_ns;
      if (Status status = raw_.sync(); !status.ok()) refused(status);
    }
    if (stop) break;
  }
  each_second();
  if (all_written() && !leave_open_.load()) (void)journal(RunEnded{});
  const MutexLock lock(mutex_);
  ended_ = true;
  written_.notify_all();
}

void RecorderThread::write_scans() {
  // A few of each in turn, so that the log is nearly in order of time even after a stall.
  constexpr int kInTurn = 4;
  bool more = true;
  while (more) {
    more = false;
    for (const driver::SensorRole role : {driver::SensorRole::kHorizontal, driver::SensorRole::kVertical}) {
      driver::ScanRing& ring = *links_.scans[static_cast<std::size_t>(role)];
      for (int i = 0; i < kInTurn; ++i) {
        const driver::DeviceScan* const measured = ring.front();
        if (measured == nullptr) break;
        write_scan(role, *measured);
        ring.pop();
        more = true;
      }
      links_.room.ring();
    }
  }
}

void RecorderThread::write_scan(driver::SensorRole role, const driver::DeviceScan& measured) {
  const auto i = static_cast<std::size_t>(role);
  const Scan& scan = stampers_[i].stamp(measured);
  clock_error_ns_[i].store(measured.error_bound_ns, std::memory_order_relaxed);
  if (links_.pause.contains(measured.first_beam_mono_ns)) return;
  const bool sent = scan_every_ > 0 && seen_[i]++ % scan_every_ == 0;
  const bool written = options_.raw && disk_.load(std::memory_order_relaxed) != DiskState::kLast;
  if (options_.raw && !written) raw_lost_.fetch_add(1, std::memory_order_relaxed);
  if (!sent && !written) return;
  const ScanOrigin origin{folder_.cart, folder_.run, static_cast<std::int64_t>(measured.device_ms),
                          measured.first_beam_mono_ns};
  std::vector<std::byte> message = encode_scan(scan, origin);
  const bool horizontal = role == driver::SensorRole::kHorizontal;
  const std::string& channel = horizontal ? channels_.scan_h : channels_.scan_v;
  if (written) {
    const std::int64_t arrived_us = folder_.clock.utime_us(measured.arrival_last_mono_ns);
    Status status;
    if ((measured.flags & driver::kScanHasIntensities) != 0) {
      const ScanIntensities intensities{
          scan.stamp_us, scan.index, {measured.intensities.begin(), measured.intensities.begin() + measured.beams}};
      status = raw_.write(horizontal ? channels_.intensity_h : channels_.intensity_v, arrived_us,
                          encode_intensities(intensities, origin));
    }
    if (status.ok()) status = raw_.write(channel, arrived_us, message);
    (status.ok() ? raw_scans_ : raw_lost_).fetch_add(1, std::memory_order_relaxed);
    if (!status.ok()) refused(status);
  }
  if (sent) links_.publisher.post(channel, std::move(message));
}

void RecorderThread::write_poses() {
  while (const MappedScan* const mapped = links_.reports.front()) {
    const ScanReport& report = mapped->report;
    const Status status = links_.poses.add({report.stamp_us, report.keyframe_scan_index, report.keyframe_from_base,
                                            report.keyframe_step, report.keyframe, report.keyframe_linked});
    links_.reports.pop();
    if (!status.ok()) {
      poses_failed_.fetch_add(1, std::memory_order_relaxed);
      refused(status);
    }
    reports_.fetch_add(1);
  }
  links_.mapper.reports_taken();
  links_.room.ring();
}

bool RecorderThread::write_submap() {
  if (unsaved_ == nullptr) {
    std::optional<FinishedSubmap> finished = links_.mapper.take_finished();
    if (!finished) return false;
    unsaved_ = std::make_shared<const FinishedSubmap>(std::move(*finished));
    write_poses();  // of its last scans, too: the run would go on from its end and never map them again
  } else if (driver::monotonic_now_ns() < next_save_ns_ && !stop_.load(std::memory_order_relaxed)) {
    return false;
  }
  const std::uint32_t index = unsaved_->id.index;
  next_save_ns_ = driver::monotonic_now_ns() + kSecond_ns;
  if (!saved_) {
    const Expected<Sha256> hash = save(*unsaved_);
    if (!hash) {
      refused(hash.error());
      return false;
    }
    saved_ = *hash;
  }
  // A run that goes on keeps the poses up to its newest sub-map.
  if (Status status = links_.poses.sync(); !status.ok()) refused(status);
  if (!journal(SubmapSaved{index, *saved_})) return false;
  links_.hashes.add(index, *saved_);
  links_.publisher.hand_over(std::move(unsaved_), *saved_);
  unsaved_ = nullptr;
  saved_.reset();
  links_.optimizer.announce(index);
  last_submap_.store(index);  // last: who saves a map waits for this and then asks the optimizer
  return true;
}

// What the archive could not read again, or is too large for it, must not stop all that come after it: its key-frames
// are kept without the cells, or its first one alone, and no link.
Expected<Sha256> RecorderThread::save(const FinishedSubmap& submap) {
  const Expected<Sha256> whole = links_.archive.save(submap);
  if (whole || whole.error().code() == StatusCode::kIo) return whole;
  refused(whole.error());
  FinishedSubmap rest = submap;
  rest.blocks.clear();
  rest.surface.clear();
  const Expected<Sha256> without_cells = links_.archive.save(rest);
  if (without_cells || without_cells.error().code() == StatusCode::kIo) {
    unsaved_ = std::make_shared<const FinishedSubmap>(std::move(rest));
    return without_cells;
  }
  Keyframe first;
  if (!submap.keyframes.empty()) {
    first.scan_index = submap.keyframes.front().scan_index;
    first.stamp_us = submap.keyframes.front().stamp_us;
  }
  rest.keyframes.assign(1, first);
  rest.odom_from_submap = is_sound(submap.odom_from_submap) ? submap.odom_from_submap : Pose2{};
  rest.linked_to_previous = false;
  unsaved_ = std::make_shared<const FinishedSubmap>(std::move(rest));
  return links_.archive.save(*unsaved_);
}

void RecorderThread::write_notes() {
  if (!noted_.exchange(false)) return;
  std::deque<JournalEvent> notes;
  {
    const MutexLock lock(mutex_);
    notes.swap(notes_);
  }
  while (!notes.empty() && journal(notes.front())) notes.pop_front();
  if (notes.empty()) return;
  // In their order, at the next look: another append may find room.
  const MutexLock lock(mutex_);
  notes_.insert(notes_.begin(), notes.begin(), notes.end());
  notes_left_ = true;
}

bool RecorderThread::journal(JournalEvent event) {
  const Status status = links_.journal.append({folder_.clock.utime_us(), std::move(event)});
  if (!status.ok()) refused(status);
  return status.ok();
}

void RecorderThread::each_second() {
  raw_bytes_.store(raw_.bytes());
  struct statvfs disk {};
  if (::statvfs(folder_.path.c_str(), &disk) == 0) {
    const std::uint64_t free = static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
    disk_free_.store(free);
    disk_.store(free < options_.disk_last_bytes  ? DiskState::kLast
                : free < options_.disk_low_bytes ? DiskState::kLow
                                                 : DiskState::kOk);
  }
  if (std::exchange(notes_left_, false)) noted_.store(true);
  const MapperState mapper = links_.mapper.state();
  const ScansShed shed{mapper.skipped, raw_lost_.load() + links_.scans[0]->dropped() + links_.scans[1]->dropped()};
  if (shed == shed_) return;
  if (journal(shed)) shed_ = shed;
}

void RecorderThread::refused(const Status& status) {
  const MutexLock lock(mutex_);
  const std::int64_t now_ns = driver::monotonic_now_ns();
  // Once for a row of the same; state() shows it meanwhile.
  if (status.message() != trouble_ || now_ns - trouble_ns_ > kTroubleLasts_ns) log(Severity::kError, status.message());
  trouble_ = status.message();
  trouble_ns_ = now_ns;
}

}  // namespace submapd
