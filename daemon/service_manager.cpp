#include "daemon/service_manager.hpp"

#include <systemd/sd-daemon.h>

namespace submapd {

ServiceManager::ServiceManager() {
  std::uint64_t watchdog_us = 0;
  if (::sd_watchdog_enabled(0, &watchdog_us) > 0) watchdog_ns_ = static_cast<std::int64_t>(watchdog_us) * 1000 / 2;
}

void ServiceManager::ready() {
  (void)::sd_notify(0, "READY=1");
}

void ServiceManager::stopping() {
  (void)::sd_notify(0, "STOPPING=1");
}

void ServiceManager::status(const std::string& words) {
  if (words == told_) return;
  told_ = words;
  (void)::sd_notify(0, ("STATUS=" + words).c_str());
}

void ServiceManager::feed_watchdog() {
  (void)::sd_notify(0, "WATCHDOG=1");
}

}  // namespace submapd
