// A recorded log as the daemon's input: fed as fast as the pipeline takes it, in the log's own time, nothing dropped.
//
// The next scan waits until its readers have room, so that the same log gives the same sub-maps. When the log ends the
// run stays open.
#pragma once

#include <atomic>
#include <thread>

#include "daemon/mutex.hpp"
#include "daemon/scan_input.hpp"
#include "daemon/scan_log.hpp"

namespace submapd {

class LogInput final : public ScanInput {
 public:
  // `path`: what replay takes. Errors: those of open_log(); kInvalidArgument for scans with more beams than ours.
  [[nodiscard]] static Expected<std::unique_ptr<LogInput>> open(const std::string& path,
                                                                const Configuration& configuration,
                                                                driver::Doorbell& mapper_bell,
                                                                driver::Doorbell& recorder_bell);
  ~LogInput() override;

  Status start() override;
  void stop() override;
  [[nodiscard]] std::string kind() const override { return "file"; }
  [[nodiscard]] RunClock clock(std::optional<std::int64_t> /*after_us*/) const override { return RunClock(now_ns_); }
  [[nodiscard]] ScanGeometry geometry() const override { return geometry_; }
  void wait_for(const std::function<bool()>& has_room, RoomBell& room) override {
    has_room_ = has_room;
    room_ = &room;
  }
  void skip_until(const std::array<std::int64_t, driver::kSensorRoles>& stamps_us) override {
    skip_until_us_ = stamps_us;
  }
  [[nodiscard]] bool ended() const override { return ended_.load(); }
  [[nodiscard]] std::string trouble() const override;
  [[nodiscard]] const Heartbeat& heartbeat() const override { return heartbeat_; }

 private:
  using ScanInput::ScanInput;
  void run(const std::stop_token& stop);
  [[nodiscard]] Status feed(const std::stop_token& stop);

  std::unique_ptr<ScanLog> log_;
  std::optional<LoggedScan> first_;
  ScanGeometry geometry_;
  std::function<bool()> has_room_;
  RoomBell* room_ = nullptr;  // that of whoever makes room; nullptr: never waits
  std::array<std::int64_t, driver::kSensorRoles> skip_until_us_{};
  std::shared_ptr<std::atomic<std::int64_t>> now_ns_ = std::make_shared<std::atomic<std::int64_t>>(0);
  Heartbeat heartbeat_;
  std::atomic<bool> ended_{false};
  mutable Mutex mutex_;
  std::string trouble_ GUARDED_BY(mutex_);
  std::jthread thread_;
};

}  // namespace submapd
