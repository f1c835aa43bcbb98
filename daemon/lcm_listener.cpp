#include "daemon/lcm_listener.hpp"

#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <utility>

#include "daemon/lcm_receive.hpp"
#include "daemon/multicast_route.hpp"
#include "daemon/realtime.hpp"

namespace submapd {
namespace {

constexpr int kListen_ms = 100;  // between two looks at the end
constexpr std::chrono::milliseconds kTryAgain{500};

}  // namespace

LcmListener::LcmListener(std::string url, std::string name, std::function<void(lcm::LCM&)> subscribe,
                         Heartbeat* heartbeat)
    : url_(std::move(url)), name_(std::move(name)), subscribe_(std::move(subscribe)), heartbeat_(heartbeat) {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

LcmListener::~LcmListener() {
  thread_.request_stop();
  thread_.join();
}

void LcmListener::beat() {
  if (heartbeat_ != nullptr) heartbeat_->beat();
}

void LcmListener::run(const std::stop_token& stop) {
  name_thread(name_.c_str());
  while (!stop.stop_requested()) {
    beat();
    if (has_multicast_route(url_)) {
      lcm::LCM network(url_);
      if (can_receive(network)) listen(network, stop);
    }
    const MutexLock lock(mutex_);
    (void)ended_.wait_for(mutex_, stop, kTryAgain, [] { return false; });
  }
}

void LcmListener::listen(lcm::LCM& network, const std::stop_token& stop) {
  subscribe_(network);
  network_.store(true);
  while (!stop.stop_requested()) {
    beat();
    if (network.handleTimeout(kListen_ms) < 0) break;
  }
  network_.store(false);
}

}  // namespace submapd
