// The scanners and the thread that listens to them: from USB to the rings of mapper and recorder.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/scan_input.hpp"
#include "daemon/scan_stamper.hpp"
#include "driver/scan_pipeline.hpp"
#include "driver/scanners.hpp"

namespace submapd {

class Acquisition final : public ScanInput {
 public:
  Acquisition(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell);
  ~Acquisition() override;

  // kUnavailable if this system has no USB to listen to. Scanners may come at any time later.
  Status start() override;
  // The streams end, the lasers go out; nothing is pushed any more when this returns.
  void stop() override;

  [[nodiscard]] std::string kind() const override { return "usb"; }
  [[nodiscard]] RunClock clock(std::optional<std::int64_t> after_us) const override {
    return after_us ? RunClock::now_after(*after_us) : RunClock::now();
  }
  [[nodiscard]] ScanGeometry geometry() const override { return utm30lx_geometry(); }
  [[nodiscard]] bool join_with(driver::OdometrySource& odometry) override {
    horizontal_.join_with(odometry);
    return true;
  }
  [[nodiscard]] std::vector<driver::ScannerInfo> scanners() const override { return scanners_.snapshot(); }
  // The thread rests while no scanner is there.
  [[nodiscard]] bool must_move() const override;
  [[nodiscard]] const Heartbeat& heartbeat() const override { return clients_.heartbeat; }

 private:
  // Passes everything on and beats after each round of events.
  struct Clients final : driver::UsbClients {
    explicit Clients(driver::Scanners& all) : scanners(all) {}
    driver::LinkClient* arrived(const driver::UsbPort& port) override { return scanners.arrived(port); }
    void cannot_open(const driver::UsbPort& port, const driver::Error& error) override {
      scanners.cannot_open(port, error);
    }
    void gone(const driver::UsbPort& port, driver::LinkClient* client, const driver::UsbCounters& counters) override {
      scanners.gone(port, client, counters);
    }
    void served() noexcept override {
      heartbeat.beat();
      scanners.served();
    }
    driver::Scanners& scanners;
    Heartbeat heartbeat;
  };

  driver::ScanPipeline horizontal_;
  driver::ScanPipeline vertical_;
  driver::Scanners scanners_;
  Clients clients_;
  std::unique_ptr<driver::UsbHost> host_;
  std::thread thread_;
};

}  // namespace submapd
