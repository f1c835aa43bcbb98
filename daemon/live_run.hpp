// One run of the daemon, from the scanners to the archive: makes all threads, wires them, ends them in order.
//
//   input ─▶ mapper ring ─▶ mapper ─▶ reports ─▶ publisher ─▶ LCM ─▶ optimizer
//    └──▶ recorder rings ─▶ recorder ◀─ reports, finished sub-maps      ▲
//                              └─▶ disk, then publisher and announce() ─┘
//
// The object belongs to the thread that made it.
#pragma once

#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <vector>

#include "daemon/clock_watch.hpp"
#include "daemon/health.hpp"
#include "daemon/map_saver.hpp"
#include "daemon/odometry_input.hpp"
#include "daemon/recorder_thread.hpp"
#include "daemon/resume_point.hpp"
#include "daemon/room_bell.hpp"
#include "daemon/run_folder.hpp"
#include "daemon/scan_input.hpp"

namespace submapd {

class LiveRun {
 public:
  // Goes on with a run that ended by a crash or a power cut, else begins one. Everything runs when this returns;
  // scanners may come later. `input` is what make_input() takes. Errors: kIo, kCorrupt, kUnavailable, kInternal, and
  // those of make_input(), in words for the operator.
  [[nodiscard]] static Expected<std::unique_ptr<LiveRun>> start(const Configuration& configuration,
                                                                const std::string& input);
  LiveRun(const LiveRun&) = delete;
  LiveRun& operator=(const LiveRun&) = delete;
  // Ends the run: maps and writes what has been received.
  ~LiveRun();

  // What it wants the operator to know from the start: which run, limits that were refused.
  [[nodiscard]] const std::vector<std::string>& remarks() const { return remarks_; }
  // Looks at everything; rates are over the last second. Call some ten times a second.
  [[nodiscard]] Health look();
  void publish(const Health& health);
  // A reply to a command that came over LCM.
  void publish(const LcmCommand& command, const ControlReply& reply);

  [[nodiscard]] MapSaver& saver() { return *saver_; }
  [[nodiscard]] RecorderThread& recorder() { return *recorder_; }
  // kUnavailable if the journal cannot take it.
  [[nodiscard]] Status pause();
  [[nodiscard]] Status resume();
  [[nodiscard]] const RunClock& clock() const { return folder_.clock; }
  [[nodiscard]] const std::vector<Mark>& marks() const { return marks_; }  // of a run that goes on

  // True if every thread that must move did since the last true answer. The usb thread rests while no scanner is there.
  [[nodiscard]] bool all_moved();

 private:
  explicit LiveRun(const Configuration& configuration);
  [[nodiscard]] Status choose_run(const std::string& input);
  [[nodiscard]] Status open_files();
  [[nodiscard]] Status go_on_with_poses();
  [[nodiscard]] Status add_missing_poses();
  [[nodiscard]] Status start_threads();
  void start_optimizer(const Channels& channels);
  void start_mapper();
  void join_odometry();
  void look_at_scanners(Health& health);
  void look_at_rates(Health& health);
  void look_at_clock();

  // What rates and reconnects are counted from, for each role.
  struct Seen {
    bool streaming = false;
    std::uint64_t connects = 0;
    std::uint64_t scans = 0;  // at the start of the second
    double rate_hz = 0.0;
  };

  const Configuration configuration_;
  RunFolder folder_;
  std::optional<ResumePoint> resume_;  // until everything runs
  std::vector<Mark> marks_;
  std::uint64_t poses_before_ = 0;
  std::vector<std::string> remarks_;

  driver::Doorbell mapper_bell_;
  driver::Doorbell recorder_bell_;
  driver::Doorbell publisher_bell_;
  driver::Doorbell input_bell_;
  RoomBell room_;  // in the rings, for an input that waits
  PauseWindow pause_;
  ReportRing to_publisher_;
  ReportRing to_recorder_;
  std::unique_ptr<OdometryInput> odometry_;  // if it is configured and the input has none of its own
  std::unique_ptr<ScanInput> input_;

  std::unique_ptr<RunJournal> journal_;
  std::unique_ptr<SubmapArchive> archive_;
  std::unique_ptr<PoseSpool> poses_;
  SubmapJournal hashes_;

  std::unique_ptr<lcm::LCM> optimizer_lcm_;
  std::unique_ptr<Optimizer> optimizer_;
  std::unique_ptr<OptimizerThread> optimizer_thread_;
  std::unique_ptr<PublisherThread> publisher_;
  std::unique_ptr<MapperThread> mapper_;
  std::unique_ptr<RecorderThread> recorder_;
  std::unique_ptr<MapSaver> saver_;

  std::vector<HeartbeatWatch> watches_;  // of mapper, recorder, publisher
  std::optional<HeartbeatWatch> input_watch_;
  ClockWatch clock_watch_;
  std::array<Seen, driver::kSensorRoles> seen_;
  std::int64_t second_began_ns_ = 0;
  std::uint64_t poses_then_ = 0;  // sent when the second began
  double pose_hz_ = 0.0;
  std::int64_t raw_since_ns_ = 0;  // the ten seconds of the disk's rate began, with ...
  std::uint64_t raw_then_ = 0;     // ... so many raw bytes
  double raw_bytes_s_ = 0.0;
};

}  // namespace submapd
