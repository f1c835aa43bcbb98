// What systemd is told: ready, status in words, watchdog, stopping (sd_notify(3)). Without systemd nothing happens.
//
// One thread.
#pragma once

#include <cstdint>
#include <string>

namespace submapd {

class ServiceManager {
 public:
  ServiceManager();

  void ready();
  void stopping();
  // One line; told only when it changes.
  void status(const std::string& words);
  void feed_watchdog();
  // How often it wants to be fed, half of what it waits; 0: it does not watch.
  [[nodiscard]] std::int64_t watchdog_ns() const { return watchdog_ns_; }

 private:
  std::int64_t watchdog_ns_ = 0;
  std::string told_;
};

}  // namespace submapd
