// Scans from CART_SCAN_H and CART_SCAN_V: a recorded run played back with lcm-logplayer, or another program's scanners.
//
// Only scans of the run that was heard first are taken. Their stamps are what time it is.
#pragma once

#include <atomic>
#include <memory>

#include "daemon/lcm_listener.hpp"
#include "daemon/scan_input.hpp"
#include "proto/channels.hpp"

namespace lcm {
struct ReceiveBuffer;
}  // namespace lcm

namespace submapd {

class LcmInput final : public ScanInput {
 public:
  LcmInput(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell);

  Status start() override;
  void stop() override;
  [[nodiscard]] std::string kind() const override { return "lcm"; }
  [[nodiscard]] RunClock clock(std::optional<std::int64_t> /*after_us*/) const override { return RunClock(now_ns_); }
  [[nodiscard]] ScanGeometry geometry() const override;
  void skip_until(const std::array<std::int64_t, driver::kSensorRoles>& stamps_us) override {
    skip_until_us_ = stamps_us;
  }
  [[nodiscard]] std::string trouble() const override;
  [[nodiscard]] const Heartbeat& heartbeat() const override { return heartbeat_; }

 private:
  static void on_scan(const lcm::ReceiveBuffer* buffer, const std::string& channel, LcmInput* self);
  void take(driver::SensorRole role, const ScanMessage& message);

  const std::string url_;
  const Channels channels_;
  std::optional<Uuid> run_;  // of the thread alone
  std::array<std::int64_t, driver::kSensorRoles> skip_until_us_{};
  std::shared_ptr<std::atomic<std::int64_t>> now_ns_ = std::make_shared<std::atomic<std::int64_t>>(0);
  Heartbeat heartbeat_;
  std::atomic<std::uint64_t> refused_{0};  // damaged, of another run, or of another scanner
  std::unique_ptr<LcmListener> listener_;  // while it is started
};

}  // namespace submapd
