// The thread that maps: pops the horizontal scanner's ring, runs the filter, hands reports on through rings.
//
// Real-time: between two scans it neither allocates, locks, logs nor waits for disk or network. Finished sub-maps stay
// in the mapper until the recorder takes them. When more than a second of scans waits, each second one is left out and
// counted until the rest is worked off.
//
// Threads: made and ended by the daemon; take_finished() by the recorder's thread, snapshot() by one saver at a time,
// heartbeat and counters by any.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "daemon/heartbeat.hpp"
#include "daemon/pause_window.hpp"
#include "daemon/room_bell.hpp"
#include "daemon/scan_stamper.hpp"
#include "driver/ring/scan_ring.hpp"
#include "slam/base/status.hpp"
#include "slam/filter/mapper.hpp"
#include "slam/output/standstill.hpp"

namespace submapd {

// What became of a scan, and when its last byte came (monotonic).
struct MappedScan {
  ScanReport report;
  std::int64_t arrived_ns = 0;
};
using ReportRing = driver::SpscRing<MappedScan>;

struct MapperThreadOptions {
  MapperOptions mapper;
  ScanGeometry geometry;
  int workers = 1;                     // threads that help with many particles
  std::uint64_t longest_backlog = 40;  // scans that may wait before some are left out
  bool real_time = true;               // take a real-time priority
  double slow_ms = 0.0;                // [experiment]: sleeps so long after each scan
  // Of a run that goes on: its newest finished sub-map, if there is one, and the scans after it that were recorded, one
  // a call. They are mapped before any other, and every report and sub-map of theirs waits until the recorder takes it.
  bool resumed = false;
  std::shared_ptr<const FinishedSubmap> last;
  std::function<std::optional<Scan>()> backlog;
  std::vector<Standstill> standstills;  // in order of time: scans of then are not mapped and get the pose before them
  std::uint64_t first_index = 0;        // of the first scan from the ring
  std::int64_t after_us = 0;            // and an instant before it
};

// Of the mapper's thread, for any other. Monotonic but for the last five, which are of the newest scan.
struct MapperState {
  std::uint64_t scans = 0;
  std::uint64_t skipped = 0;      // received and not mapped: left out to catch up, or the ring was full
  std::uint64_t missing = 0;      // numbers that never came, by the sensor's count of turns
  std::uint64_t lost = 0;         // mapped scans that fitted nowhere
  std::uint64_t by_odometry = 0;  // mapped scans that odometry led to
  int particles = 0;
  double n_eff = 0.0;
  bool degenerate = false;
  bool last_lost = false;
  std::int64_t stamp_us = 0;
};

// The run as it stands between two scans.
struct OpenRun {
  std::optional<FinishedSubmap> open;  // the sub-map that still grows; nothing before the first scan
  std::uint64_t reports = 0;           // handed to the recorder so far
};

class MapperThread {
 public:
  // Starts. `bell` is rung by the producer of `scans`; `room` when there is room in them. All must outlive the object.
  MapperThread(const MapperThreadOptions& options, const Uuid& cart, const Uuid& run, RunClock clock,
               driver::ScanRing& scans, driver::Doorbell& bell, RoomBell& room, const PauseWindow& pause,
               ReportRing& to_publisher, ReportRing& to_recorder);
  MapperThread(const MapperThread&) = delete;
  MapperThread& operator=(const MapperThread&) = delete;
  // Without finish() the open sub-map is given up.
  ~MapperThread();

  // Maps what is in the ring, closes the run and ends the thread. REQUIRES: nothing is pushed any more, and somebody
  // takes finished sub-maps; one that is still there when this returns is the last. False if the run must go on later:
  // scans that were recorded before it was resumed are not mapped yet, and the run is not closed.
  bool finish();

  [[nodiscard]] bool has_finished() const { return mapper_->has_finished(); }
  [[nodiscard]] std::optional<FinishedSubmap> take_finished();
  // Reports were taken from `to_recorder`: a run that is resumed waits for room there.
  void reports_taken() { backlog_room_.ring(); }

  // A copy of the run between two scans. kUnavailable if the mapper has not answered within two seconds.
  [[nodiscard]] Expected<OpenRun> snapshot();

  [[nodiscard]] const Heartbeat& heartbeat() const { return heartbeat_; }
  [[nodiscard]] MapperState state() const;
  [[nodiscard]] std::size_t bytes_limit() const { return bytes_limit_; }  // of the mapper's pools
  // Why there is no real-time priority; set before the constructor returns.
  [[nodiscard]] const Status& priority() const { return priority_; }

 private:
  enum class Stop : std::uint8_t { kNo, kFinish, kNow };
  void run();
  void work_off_backlog();
  void note(const ScanReport& report);
  void loop();
  void process_waiting();
  void map(const driver::DeviceScan& measured);
  void serve_snapshot();
  void close_run();
  void stop(Stop how);

  MapperThreadOptions options_;
  const Uuid cart_;
  const Uuid run_;
  driver::ScanRing& scans_;
  driver::Doorbell& bell_;
  RoomBell& room_;
  const PauseWindow& pause_;
  ReportRing& to_publisher_;
  ReportRing& to_recorder_;

  // Of the thread alone.
  ScanStamper stamper_;
  std::uint64_t popped_ = 0;
  bool skip_next_ = false;

  std::unique_ptr<WorkerPool> pool_;
  std::unique_ptr<Mapper> mapper_;
  std::size_t bytes_limit_ = 0;
  Status priority_;
  Heartbeat heartbeat_;
  std::atomic<Stop> stop_{Stop::kNo};
  bool whole_ = true;  // the thread's while it runs

  std::atomic<bool> snapshot_wanted_{false};
  std::atomic<bool> snapshot_ready_{false};
  OpenRun snapshot_;  // the mapper's until ready, then the saver's
  driver::Doorbell snapshot_bell_;
  driver::Doorbell backlog_bell_;  // not bell_, which would wake the thread for nothing once it maps live
  RoomBell backlog_room_{backlog_bell_};

  std::atomic<std::uint64_t> mapped_{0};
  std::atomic<std::uint64_t> skipped_{0};
  std::atomic<std::uint64_t> missing_{0};
  std::atomic<std::uint64_t> lost_{0};
  std::atomic<std::uint64_t> by_odometry_{0};
  std::atomic<int> particles_{0};
  std::atomic<double> n_eff_{0.0};
  std::atomic<bool> degenerate_{false};
  std::atomic<bool> last_lost_{false};
  std::atomic<std::int64_t> stamp_us_{0};

  std::thread thread_;
};

// A doorbell, or an exception where the system has no descriptors left: for start-up.
[[nodiscard]] driver::Doorbell make_doorbell();

}  // namespace submapd
