// All scanners that are plugged in: who they are, which role each has, and where its scans go.
//
// Threads: the UsbClients part on the event thread. snapshot() and ask_for_time() from any thread; they take a lock
// that the event thread takes when scanners come and go, and otherwise only if it is free, so that a reader never holds
// up the bytes. Nothing is logged here: who wants to tell of changes compares snapshots.
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "driver/sensor.hpp"
#include "driver/sensor_roles.hpp"
#include "driver/usb/usb_host.hpp"

namespace submapd::driver {

struct ScannersOptions {
  RoleRules roles;
  bool intensity = false;  // ME in place of MD
  SensorOptions sensor;
};

struct ScannerInfo {
  UsbPort port;
  SensorStatus status;
  std::optional<SensorRole> role;
  SensorCounters counters;
};

class Scanners final : public UsbClients {
 public:
  // Where the scans of each role go, by SensorRole. REQUIRES: the sinks outlive this.
  Scanners(ScannersOptions options, std::array<SensorSink*, kSensorRoles> sinks);
  Scanners(const Scanners&) = delete;
  Scanners& operator=(const Scanners&) = delete;
  ~Scanners();

  // All that are plugged in, in the order in which they came; also those that cannot be opened.
  [[nodiscard]] std::vector<ScannerInfo> snapshot() const;
  // The cart stands still: every scanner measures its clock again.
  void ask_for_time();

  LinkClient* arrived(const UsbPort& port) override;
  void cannot_open(const UsbPort& port, const Error& error) override;
  void gone(const UsbPort& port, LinkClient* client, const UsbCounters& counters) override;
  void served() noexcept override;

 private:
  class Scanner;
  [[nodiscard]] Expected<SensorAssignment> assign(Scanner& scanner, const SensorIdentity& identity);

  ScannersOptions options_;
  std::array<SensorSink*, kSensorRoles> sinks_;
  std::vector<std::unique_ptr<Scanner>> scanners_;  // changed by the event thread, with mutex_ held
  mutable std::mutex mutex_;
  bool changed_ = false;  // event thread only: something is not published yet
};

}  // namespace submapd::driver
