// The thread that writes: raw scans of both scanners, finished sub-maps, the journal, the pose of each scan.
//
// It alone touches the disk while a run lasts (but for saved maps), and nobody waits for it: its rings are long, and
// what a full one drops is counted. A sub-map is saved, synced and in the journal before anybody else hears of it; when
// the disk refuses it is kept and tried again; one that could never be read again is replaced by what is left of it. A
// run that could not be written to its end stays open, and goes on at the next start. Threads: made and ended by the
// daemon; note(), leave_open() and state() by any.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
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
  RoomBell& room;          // rung when something was taken out of them
  MapperThread& mapper;
  SubmapArchive& archive;
  SubmapJournal& hashes;
  RunJournal& journal;
  PoseSpool& poses;
  PublisherThread& publisher;
  OptimizerThread& optimizer;
};

// Where a run that goes on stands.
struct RecorderStart {
  int raw_file = 0;
  std::array<std::uint64_t, driver::kSensorRoles> index{};    // of the next scan, by SensorRole
  std::array<std::int64_t, driver::kSensorRoles> after_us{};  // and an instant before it
  std::int64_t last_submap = -1;
};

class RecorderThread {
 public:
  // Starts.
  RecorderThread(const Configuration& configuration, const RunFolder& run, const ScanGeometry& geometry,
                 const RecorderStart& start, const RecorderLinks& links);
  RecorderThread(const RecorderThread&) = delete;
  RecorderThread& operator=(const RecorderThread&) = delete;
  ~RecorderThread();

  // Writes what is there, closes the run, ends the thread. REQUIRES: nothing comes any more.
  void finish();

  // Into the journal, soon. False if too many wait.
  bool note(JournalEvent event);
  // The run is not closed at the end: it is not mapped to its end yet.
  void leave_open() { leave_open_.store(true); }

  [[nodiscard]] const Heartbeat& heartbeat() const { return heartbeat_; }
  [[nodiscard]] RecorderState state() const;
  // Until so many reports of the mapper and this sub-map are written; false if they are not after `patience`, or the
  // thread has ended.
  [[nodiscard]] bool wait_until(std::uint64_t reports, std::int64_t submap, std::chrono::milliseconds patience);

 private:
  void run();
  void write_scans();
  void write_scan(driver::SensorRole role, const driver::DeviceScan& measured);
  void write_poses();
  // True if something was written.
  bool write_submap();
  [[nodiscard]] Expected<Sha256> save(const FinishedSubmap& submap);
  [[nodiscard]] bool all_written() const { return unsaved_ == nullptr && !links_.mapper.has_finished(); }
  void write_notes();
  [[nodiscard]] bool journal(JournalEvent event);
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
  std::optional<Sha256> saved_;  // of unsaved_, if it is in the archive and only the journal refuses
  std::int64_t next_save_ns_ = 0;
  std::int64_t next_sync_ns_ = 0;
  std::int64_t next_second_ns_ = 0;
  ScansShed shed_;           // as the journal has it
  bool notes_left_ = false;  // refused by the disk, for the next second

  Heartbeat heartbeat_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> leave_open_{false};
  std::atomic<bool> noted_{false};
  std::atomic<std::uint64_t> raw_scans_{0};
  std::atomic<std::uint64_t> raw_lost_{0};
  std::atomic<std::int64_t> last_submap_;
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
  bool ended_ GUARDED_BY(mutex_) = false;
  std::atomic<int> waiting_{0};
  std::condition_variable_any written_;

  std::thread thread_;
};

}  // namespace submapd
