// What may come in over LCM from others: CART_TRIGGER and CART_COMMAND, each only if it is configured.
//
// A thread of its own listens; what is sound waits in a short queue for the control thread. Nobody on the network is
// authenticated: what does not decode is counted and forgotten, and more than the queue holds is, too. Threads: made
// and ended by the control thread, which takes requests when fd() is readable; counters() by any.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>

#include "daemon/configuration.hpp"
#include "daemon/control_protocol.hpp"
#include "daemon/lcm_listener.hpp"
#include "daemon/mutex.hpp"

namespace submapd {

struct LcmInputCounters {
  std::uint64_t taken = 0;
  std::uint64_t bad = 0;      // not of the channel's type, or no name
  std::uint64_t dropped = 0;  // more than can wait
};

class LcmRequests {
 public:
  // Throws std::system_error where there is no descriptor. Without a network it tries again now and then.
  explicit LcmRequests(const LcmConfiguration& configuration);
  LcmRequests(const LcmRequests&) = delete;
  LcmRequests& operator=(const LcmRequests&) = delete;
  ~LcmRequests();

  [[nodiscard]] int fd() const { return fd_; }
  // The next request in order of coming.
  [[nodiscard]] std::optional<ControlRequest> take();
  [[nodiscard]] LcmInputCounters counters() const;

  // For the thread and for tests. Errors: kCorrupt, kInvalidArgument.
  [[nodiscard]] static Expected<ControlRequest> decode_trigger(std::span<const std::byte> bytes);
  [[nodiscard]] static Expected<ControlRequest> decode_command(std::span<const std::byte> bytes);

 private:
  void subscribe(lcm::LCM& network);
  void on_message(Expected<ControlRequest> request);

  const LcmConfiguration configuration_;
  const int fd_;
  std::atomic<std::uint64_t> taken_{0};
  std::atomic<std::uint64_t> bad_{0};
  std::atomic<std::uint64_t> dropped_{0};
  Mutex mutex_;
  std::deque<ControlRequest> requests_ GUARDED_BY(mutex_);
  std::optional<LcmListener> listener_;
};

}  // namespace submapd
