#include "daemon/mapper_thread.hpp"

#include <chrono>
#include <future>
#include <stdexcept>
#include <utility>

#include "daemon/realtime.hpp"
#include "daemon/thread_pool.hpp"

namespace submapd {
namespace {

constexpr std::chrono::milliseconds kIdle{100};  // between heartbeats when no scan comes
// A scan after which the cart is sought all around takes a tenth of a second, on a busy machine or under a sanitizer
// seconds.
constexpr std::chrono::milliseconds kSnapshotPatience{10'000};
constexpr std::chrono::milliseconds kTakePatience{5000};

// Of a scan at the place of another.
ScanReport same_place(ScanReport report, const Scan& scan) {
  report.scan_index = scan.index;
  report.stamp_us = scan.stamp_us;
  report.keyframe = false;
  report.keyframe_step = {};
  report.keyframe_linked = false;
  return report;
}

}  // namespace

driver::Doorbell make_doorbell() {
  driver::Expected<driver::EventFd> event = driver::EventFd::open();
  if (!event) throw std::runtime_error(event.error().message);
  return driver::Doorbell(std::move(*event));
}

MapperThread::MapperThread(const MapperThreadOptions& options, const Uuid& cart, const Uuid& run, RunClock clock,
                           driver::ScanRing& scans, driver::Doorbell& bell, RoomBell& room, const PauseWindow& pause,
                           ReportRing& to_publisher, ReportRing& to_recorder)
    : options_(options),
      cart_(cart),
      run_(run),
      scans_(scans),
      bell_(bell),
      room_(room),
      pause_(pause),
      to_publisher_(to_publisher),
      to_recorder_(to_recorder),
      stamper_(std::move(clock), options.geometry, options.first_index, options.after_us),
      snapshot_bell_(make_doorbell()),
      backlog_bell_(make_doorbell()) {
  std::promise<void> ready;
  std::future<void> made = ready.get_future();
  thread_ = std::thread([this, &ready] {
    name_thread("mapper");
    try {
      // Workers inherit the priority.
      if (options_.real_time) priority_ = take_fifo_priority(kMapperPriority);
      pool_ = std::make_unique<ThreadPool>(options_.workers + 1);
      mapper_ = std::make_unique<Mapper>(options_.mapper, cart_, run_, *pool_);
      for (const ByteBudget& budget : mapper_->budgets()) bytes_limit_ += budget.limit;
      // Before anybody can take what it closes meanwhile: that sub-map is in the archive.
      if (options_.last) mapper_->resume_after(*options_.last);
    } catch (...) {
      ready.set_exception(std::current_exception());
      return;
    }
    ready.set_value();
    this->run();
  });
  try {
    made.get();
  } catch (...) {
    thread_.join();
    throw;
  }
}

MapperThread::~MapperThread() {
  stop(Stop::kNow);
}

bool MapperThread::finish() {
  stop(Stop::kFinish);
  return whole_;
}

void MapperThread::stop(Stop how) {
  if (!thread_.joinable()) return;
  stop_.store(how);
  bell_.ring();
  backlog_room_.ring();
  thread_.join();
}

std::optional<FinishedSubmap> MapperThread::take_finished() {
  std::optional<FinishedSubmap> taken = mapper_->take_finished();
  if (taken) {
    bell_.ring();  // the end of the run may wait for this
    backlog_room_.ring();
    room_.ring();
  }
  return taken;
}

Expected<OpenRun> MapperThread::snapshot() {
  snapshot_ready_.store(false);
  snapshot_wanted_.store(true);
  bell_.ring();
  const auto answered = [this] { return snapshot_ready_.load(); };
  if (!snapshot_bell_.wait(answered, kSnapshotPatience)) {
    const bool begun = !snapshot_wanted_.exchange(false);
    if (!begun || !snapshot_bell_.wait(answered, kSnapshotPatience)) {
      return failure(StatusCode::kUnavailable, "the mapper did not answer; is the machine overloaded?");
    }
  }
  return std::exchange(snapshot_, {});
}

MapperState MapperThread::state() const {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  return {mapped_.load(kRelaxed),      skipped_.load(kRelaxed) + scans_.dropped(),
          missing_.load(kRelaxed),     lost_.load(kRelaxed),
          by_odometry_.load(kRelaxed), particles_.load(kRelaxed),
          n_eff_.load(kRelaxed),       degenerate_.load(kRelaxed),
          last_lost_.load(kRelaxed),   stamp_us_.load(kRelaxed)};
}

void MapperThread::run() {
  if (options_.resumed) work_off_backlog();
  if (whole_) loop();
  if (whole_ && stop_.load() == Stop::kFinish) close_run();
}

// Not real-time: this reads the disk, and waits for the recorder, so that nothing is lost and nothing depends on time.
void MapperThread::work_off_backlog() {
  if (options_.real_time && priority_.ok()) give_up_fifo_priority();
  std::optional<ScanReport> before;
  auto standstill = options_.standstills.begin();
  while (const std::optional<Scan> scan = options_.backlog()) {
    const auto taken = [this] {
      return (to_recorder_.size() < to_recorder_.capacity() && !mapper_->has_finished()) || stop_.load() != Stop::kNo;
    };
    while (!backlog_room_.wait(taken, kIdle)) heartbeat_.beat();
    if (stop_.load() != Stop::kNo) {
      whole_ = false;
      return;
    }
    while (standstill != options_.standstills.end() && standstill->last_us < scan->stamp_us) ++standstill;
    const bool stood = before && standstill != options_.standstills.end() && standstill->contains(scan->stamp_us);
    const ScanReport report = stood ? same_place(*before, *scan) : mapper_->process(*scan);
    if (stood) mapper_->stood_until(scan->stamp_us);
    before = report;
    MappedScan* const slot = to_recorder_.claim();
    *slot = {report, scan->stamp_us * 1000};
    to_recorder_.publish();
    note(report);
    heartbeat_.beat();
    serve_snapshot();
  }
  options_.backlog = nullptr;  // holds a reader's buffers
  options_.last.reset();
  mapper_->expect_gap();
  if (options_.real_time && priority_.ok()) (void)take_fifo_priority(kMapperPriority);
}

void MapperThread::note(const ScanReport& report) {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  mapped_.fetch_add(1, kRelaxed);
  missing_.store(stamper_.missing(), kRelaxed);
  if (report.lost) lost_.fetch_add(1, kRelaxed);
  if (report.odometry_used) by_odometry_.fetch_add(1, kRelaxed);
  particles_.store(report.particles, kRelaxed);
  n_eff_.store(report.n_eff, kRelaxed);
  degenerate_.store(report.degenerate, kRelaxed);
  last_lost_.store(report.lost, kRelaxed);
  stamp_us_.store(report.stamp_us, kRelaxed);
}

void MapperThread::loop() {
  const auto something = [this] { return scans_.has_data() || snapshot_wanted_.load() || stop_.load() != Stop::kNo; };
  for (;;) {
    bell_.wait(something, kIdle);
    heartbeat_.beat();
    const Stop stop = stop_.load();
    process_waiting();
    serve_snapshot();
    if (stop != Stop::kNo) return;  // seen before the ring was emptied: nothing comes after it
  }
}

void MapperThread::process_waiting() {
  while (const driver::DeviceScan* const measured = scans_.front()) {
    if (stop_.load(std::memory_order_relaxed) == Stop::kNow) return;
    // With half of the scans the filter still tracks; with none for a second it does not.
    const bool behind = scans_.published() - popped_ > options_.longest_backlog;
    skip_next_ = behind && !skip_next_;
    if (pause_.contains(measured->first_beam_mono_ns)) {
      (void)stamper_.stamp(*measured);
    } else if (skip_next_) {
      skipped_.fetch_add(1, std::memory_order_relaxed);
      (void)stamper_.stamp(*measured);
    } else {
      map(*measured);
      if (options_.slow_ms > 0.0)
        std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(options_.slow_ms));
    }
    scans_.pop();
    room_.ring();
    ++popped_;
    heartbeat_.beat();
    serve_snapshot();
  }
}

void MapperThread::map(const driver::DeviceScan& measured) {
  const std::int64_t arrived_ns = measured.arrival_last_mono_ns;
  const ScanReport report = mapper_->process(stamper_.stamp(measured));
  for (ReportRing* const ring : {&to_publisher_, &to_recorder_}) {
    if (MappedScan* const slot = ring->claim()) {
      *slot = {report, arrived_ns};
      ring->publish();
    }
  }
  note(report);
}

// The one place where this thread allocates: somebody saves the map, and the ring holds what comes meanwhile.
void MapperThread::serve_snapshot() {
  if (!snapshot_wanted_.load(std::memory_order_relaxed) || !snapshot_wanted_.exchange(false)) return;
  snapshot_ = {mapper_->snapshot_open(), to_recorder_.published()};
  snapshot_ready_.store(true);
  snapshot_bell_.ring();
}

// The last sub-map can close only when the one before has been taken.
void MapperThread::close_run() {
  bell_.wait([this] { return !mapper_->has_finished(); }, kTakePatience);
  whole_ = !mapper_->has_finished();
  if (whole_) mapper_->finish_run();
}

}  // namespace submapd
