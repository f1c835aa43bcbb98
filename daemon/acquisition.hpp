// The scanners and the thread that listens to them: from USB to the rings of mapper and recorder.
//
// Threads: made, started and stopped by the daemon; the rings' consumers are the mapper and the recorder; scanners(),
// heartbeat() and quiet() by any.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/heartbeat.hpp"
#include "driver/scan_pipeline.hpp"
#include "driver/scanners.hpp"

namespace submapd {

class Acquisition {
 public:
  // The bells are rung when a ring has something; they must outlive the object.
  Acquisition(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell);
  Acquisition(const Acquisition&) = delete;
  Acquisition& operator=(const Acquisition&) = delete;
  ~Acquisition();

  // kUnavailable if this system has no USB to listen to. Scanners may come at any time later.
  [[nodiscard]] Status start();
  // The streams end, the lasers go out; nothing is pushed any more when this returns.
  void stop();

  [[nodiscard]] driver::ScanRing& mapper_ring() { return mapper_ring_; }
  [[nodiscard]] driver::ScanRing& recorder_ring(driver::SensorRole role) {
    return role == driver::SensorRole::kHorizontal ? recorder_h_ : recorder_v_;
  }
  [[nodiscard]] std::vector<driver::ScannerInfo> scanners() const { return scanners_.snapshot(); }
  [[nodiscard]] const Heartbeat& heartbeat() const { return clients_.heartbeat; }
  [[nodiscard]] const Status& priority() const { return priority_; }

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

  driver::ScanRing mapper_ring_;
  driver::ScanRing recorder_h_;
  driver::ScanRing recorder_v_;
  driver::ScanPipeline horizontal_;
  driver::ScanPipeline vertical_;
  driver::Scanners scanners_;
  Clients clients_;
  std::unique_ptr<driver::UsbHost> host_;
  Status priority_;
  std::thread thread_;
};

}  // namespace submapd
