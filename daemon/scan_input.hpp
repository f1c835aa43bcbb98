// Where scans come from: USB, a log, or LCM. Fills three rings, one of the mapper and one of the recorder for each
// role.
//
// Threads: made, started and stopped by the daemon; what fills the rings is one thread of the input's own. The rings'
// consumers are the mapper and the recorder; scanners(), ended(), trouble(), moved() by any.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/heartbeat.hpp"
#include "daemon/room_bell.hpp"
#include "daemon/run_clock.hpp"
#include "driver/ring/scan_ring.hpp"
#include "driver/scan_pipeline.hpp"
#include "driver/scanners.hpp"
#include "proto/scan_conversion.hpp"

namespace submapd {

class ScanInput {
 public:
  // The bells are rung when a ring has something; they must outlive the object.
  ScanInput(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell)
      : mapper_ring_(static_cast<std::size_t>(configuration.daemon.mapper_ring), &mapper_bell),
        recorder_h_(static_cast<std::size_t>(configuration.daemon.recorder_ring), &recorder_bell),
        recorder_v_(static_cast<std::size_t>(configuration.daemon.recorder_ring), &recorder_bell) {}
  ScanInput(const ScanInput&) = delete;
  ScanInput& operator=(const ScanInput&) = delete;
  virtual ~ScanInput() = default;

  [[nodiscard]] virtual Status start() = 0;
  // Nothing is pushed any more when this returns.
  virtual void stop() = 0;

  // "usb", "lcm" or "file", as the journal has it.
  [[nodiscard]] virtual std::string kind() const = 0;
  // The clock of a run that begins now, or goes on after an instant of its own.
  [[nodiscard]] virtual RunClock clock(std::optional<std::int64_t> after_us) const = 0;
  [[nodiscard]] virtual ScanGeometry geometry() const = 0;
  // A source that can wait for its readers does so before each scan, until `has_room`; what makes room rings `room`,
  // which must outlive the input. Before start().
  virtual void wait_for(const std::function<bool()>& has_room, RoomBell& room) {
    (void)has_room;
    (void)room;
  }
  // A source that can leaves out what a run has already: scans up to these stamps, by SensorRole. Before start().
  virtual void skip_until(const std::array<std::int64_t, driver::kSensorRoles>& stamps_us) { (void)stamps_us; }

  // Scans that come without odometry are joined with this; false if they bring their own. Before start(); the source
  // must outlive the input.
  [[nodiscard]] virtual bool join_with(driver::OdometrySource& odometry) {
    (void)odometry;
    return false;
  }

  [[nodiscard]] virtual std::vector<driver::ScannerInfo> scanners() const { return {}; }
  // Nothing comes any more.
  [[nodiscard]] virtual bool ended() const { return false; }
  // Why nothing comes; empty if all is well.
  [[nodiscard]] virtual std::string trouble() const { return {}; }
  // False while the thread may rest without beating.
  [[nodiscard]] virtual bool must_move() const { return true; }
  [[nodiscard]] virtual const Heartbeat& heartbeat() const = 0;
  [[nodiscard]] const Status& priority() const { return priority_; }  // after start()

  [[nodiscard]] driver::ScanRing& mapper_ring() { return mapper_ring_; }
  [[nodiscard]] driver::ScanRing& recorder_ring(driver::SensorRole role) {
    return role == driver::SensorRole::kHorizontal ? recorder_h_ : recorder_v_;
  }

 protected:
  // Whether a scan of a message can go into our rings.
  [[nodiscard]] bool fits(const Scan& scan) const;
  // Puts it into the rings of its role; one that is full drops and counts. REQUIRES: fits().
  void push(driver::SensorRole role, const ScanMessage& message);

  driver::ScanRing mapper_ring_;
  driver::ScanRing recorder_h_;
  driver::ScanRing recorder_v_;
  Status priority_;
};

// `name` is usb, lcm or the path of a log. Errors: those of open_log().
[[nodiscard]] Expected<std::unique_ptr<ScanInput>> make_input(const std::string& name,
                                                              const Configuration& configuration,
                                                              driver::Doorbell& mapper_bell,
                                                              driver::Doorbell& recorder_bell);

}  // namespace submapd
