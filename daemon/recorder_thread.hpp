// The thread that writes: raw scans of both scanners, finished sub-maps, the journal, the pose of each scan.
//
// It alone touches the disk while a run lasts (but for saved maps), and nobody waits for it: its rings are long, and
// what a full one drops is counted. A sub-map is saved, synced and in the journal before anybody else hears of it; when
// the disk refuses it is kept and tried again. Threads: made and ended by the daemon; note() and state() by any.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "daemon/configuration.hpp"
#include "daemon/heartbeat.hpp"
#include "daemon/mapper_thread.hpp"
#include "daemon/mutex.hpp"
#include "daemon/publisher_thread.hpp"
#include "daemon/raw_log.hpp"
#include "daemon/run_folder.hpp"
#include "daemon/run_journal.hpp"
#include "daemon/submap_journal.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/submap/submap_archive.hpp"

namespace submapd {

enum class DiskState : std::uint8_t { kOk, kLow, kLast };  // health_t's

struct RecorderState {
  std::uint64_t raw_scans = 0;
  std::uint64_t raw_lost = 0;      // not written: no room, or the disk refused
  std::int64_t last_submap = -1;   // newest in archive and journal
  std::uint64_t reports = 0;       // of the mapper, taken
  std::uint64_t poses_failed = 0;  // of them, not spooled
  std::uint64_t disk_free_bytes = 0;
  std::uint64_t raw_bytes = 0;                                      // of the run's raw log, by this process
  std::array<std::int64_t, driver::kSensorRoles> clock_error_ns{};  // bound of the newest scan's stamp, by SensorRole
  DiskState disk = DiskState::kOk;
  std::string trouble;  // what the disk refuses now; empty if nothing
};

// What the recorder works with. All must outlive it.
struct RecorderLinks {
  std::array<driver::ScanRing*, driver::kSensorRoles> scans;  // by SensorRole
  ReportRing& reports;
  const PauseWindow& pause;
  driver::Doorbell& bell;  // rung by the producers of all three rings
  MapperThread& mapper;
  SubmapArchive& archive;
  SubmapJournal& hashes;
  RunJournal& journal;
  PoseSpool& poses;
  PublisherThread& publisher;
  OptimizerThread& optimizer;
};

class RecorderThread {
 public:
  // Starts.
  RecorderThread(const Configuration& configuration, const RunFolder& run, const RecorderLinks& links);
  RecorderThread(const RecorderThread&) = delete;
  RecorderThread& operator=(const RecorderThread&) = delete;
  // Writes what is there, closes the journal, ends.
  ~RecorderThread();

  // Into the journal, soon. False if too many wait.
  bool note(JournalEvent event);

  [[nodiscard]] const Heartbeat& heartbeat() const { return heartbeat_; }
  [[nodiscard]] RecorderState state() const;

 private:
  void run();
  void write_scans();
  void write_scan(driver::SensorRole role, const driver::DeviceScan& measured);
  void write_poses();
  void write_submap();
  void write_notes();
  void journal(JournalEvent event);
  void each_second();
  void refused(const Status& status);

  const RecorderConfiguration options_;
  const Channels channels_;
  const std::uint64_t scan_every_;
  const RunFolder folder_;
  const RecorderLinks links_;

  // Of the thread alone.
  RawLog raw_;
  std::array<ScanStamper, driver::kSensorRoles> stampers_;
  std::array<std::uint64_t, driver::kSensorRoles> seen_{};
  std::shared_ptr<const FinishedSubmap> unsaved_;
  std::int64_t next_save_ns_ = 0;
  std::int64_t next_sync_ns_ = 0;
  std::int64_t next_second_ns_ = 0;
  ScansShed shed_;  // as the journal has it

  Heartbeat heartbeat_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> noted_{false};
  std::atomic<std::uint64_t> raw_scans_{0};
  std::atomic<std::uint64_t> raw_lost_{0};
  std::atomic<std::int64_t> last_submap_{-1};
  std::atomic<std::uint64_t> reports_{0};
  std::atomic<std::uint64_t> poses_failed_{0};
  std::atomic<std::uint64_t> disk_free_{0};
  std::atomic<std::uint64_t> raw_bytes_{0};
  std::array<std::atomic<std::int64_t>, driver::kSensorRoles> clock_error_ns_{};
  std::atomic<DiskState> disk_{DiskState::kOk};

  mutable Mutex mutex_;
  std::deque<JournalEvent> notes_ GUARDED_BY(mutex_);
  std::string trouble_ GUARDED_BY(mutex_);
  std::int64_t trouble_ns_ GUARDED_BY(mutex_) = 0;

  std::thread thread_;
};

}  // namespace submapd
