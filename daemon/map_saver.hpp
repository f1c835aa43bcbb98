// Saves the map while mapping goes on: a copy of the open sub-map, a solve on a copy of the graph, files aside, rename.
//
// A thread of its own that works on one request at a time. Threads: start() and progress() by any.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/mapper_thread.hpp"
#include "daemon/mutex.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/recorder_thread.hpp"
#include "daemon/run_folder.hpp"
#include "slam/output/run_outputs.hpp"

namespace submapd {

struct SaveRequest {
  std::string id;    // the asker's: the same id again is the same request
  std::string name;  // empty: map-YYYYmmdd-HHMMSS in UTC
  bool force = false;
  bool cloud = false;
  bool picture_only = false;  // get-map: RUN/live.png, from the graph as it is
  std::vector<Mark> marks;    // in order of time
};

enum class SaveState { kNone, kWorking, kDone, kFailed };

// Of the newest request.
struct SaveProgress {
  bool picture_only = false;
  SaveState state = SaveState::kNone;
  std::string id;
  std::string name;
  int percent = 0;
  std::uint64_t cloud_bytes = 0;  // the size cloud.ply will have, as soon as it is known
  std::string path;               // of the map or the picture, when done
  std::int64_t ended_ns = 0;      // monotonic, when done or failed
  Status status;                  // why it failed
};

// What the saver works with. All must outlive it.
struct SaverLinks {
  MapperThread& mapper;
  RecorderThread& recorder;
  OptimizerThread& optimizer;
  const PoseSpool& poses;
  std::uint64_t poses_before = 0;  // in the spool when the run went on
};

class MapSaver {
 public:
  MapSaver(const Configuration& configuration, const RunFolder& run, const SaverLinks& links);
  MapSaver(const MapSaver&) = delete;
  MapSaver& operator=(const MapSaver&) = delete;
  // A request that is worked on ends soon, and fails.
  ~MapSaver();

  // Until no request is worked on; false if one still is after `patience`.
  [[nodiscard]] bool wait_until_idle(std::chrono::milliseconds patience);

  // Begins and returns how it stands; for an id that is known, how that stands. Errors: kUnavailable (another request
  // is worked on), kInvalidArgument (the name).
  [[nodiscard]] Expected<SaveProgress> start(SaveRequest request);
  [[nodiscard]] SaveProgress progress() const;
  // Of the clouds from now on.
  void set_mount(const ScannerMount& mount);

 private:
  void run();
  [[nodiscard]] Status save(const SaveRequest& request);
  [[nodiscard]] Status draw();
  // What is known between two scans.
  [[nodiscard]] Expected<OpenRun> look();
  // The open run, and the final graph with it.
  struct Solved {
    OpenRun run;
    std::shared_ptr<const FinishedSubmap> open;
    FinalResult result;
  };
  [[nodiscard]] Expected<Solved> solve();
  [[nodiscard]] Status wait_for_recorder(const OpenRun& run);
  [[nodiscard]] Expected<CloudSize> size_cloud(const OptimizedTrajectory& trajectory, const ScannerMount& mount);
  [[nodiscard]] Status write_report(const std::filesystem::path& path, const std::string& name, const Solved& solved,
                                    const RunOutputsSummary& written) const;
  [[nodiscard]] OpenCloudScans vertical_scans() const;
  void tell(int percent);

  const Configuration configuration_;
  const RunFolder folder_;
  const SaverLinks links_;

  mutable Mutex mutex_;
  std::condition_variable_any wanted_;
  std::condition_variable_any idle_;
  std::optional<SaveRequest> request_ GUARDED_BY(mutex_);
  SaveProgress progress_ GUARDED_BY(mutex_);
  ScannerMount mount_ GUARDED_BY(mutex_);
  std::atomic<bool> stop_{false};  // set with mutex_ held

  std::thread thread_;
};

}  // namespace submapd
