// A thread that listens to LCM: subscribes as soon as there is a network, and again when it was gone.
//
// Threads: made and ended by one; network() by any. What subscribe() subscribes is called on the thread.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <string>
#include <thread>

#include "daemon/heartbeat.hpp"
#include "daemon/mutex.hpp"

namespace lcm {
class LCM;
}  // namespace lcm

namespace submapd {

class LcmListener {
 public:
  // Starts. `subscribe` is called for each network that is found; `heartbeat`, if there is one, beats at each turn.
  LcmListener(std::string url, std::string name, std::function<void(lcm::LCM&)> subscribe,
              Heartbeat* heartbeat = nullptr);
  LcmListener(const LcmListener&) = delete;
  LcmListener& operator=(const LcmListener&) = delete;
  // Nothing is called any more when this returns.
  ~LcmListener();

  [[nodiscard]] bool network() const { return network_.load(); }

 private:
  void run(const std::stop_token& stop);
  void beat();
  void listen(lcm::LCM& network, const std::stop_token& stop);

  const std::string url_;
  const std::string name_;
  const std::function<void(lcm::LCM&)> subscribe_;
  Heartbeat* const heartbeat_;
  std::atomic<bool> network_{false};
  Mutex mutex_;
  std::condition_variable_any ended_;
  std::jthread thread_;
};

}  // namespace submapd
