// What may come in over LCM from others: CART_TRIGGER and CART_COMMAND, each only if it is configured.
//
// A thread of its own listens; what is sound waits in a short queue for the control thread. Nobody on the network is
// authenticated: what does not decode is counted and forgotten, and more than the queue holds is, too. A command is
// answered (CART_REPLY), also one that cannot be. Threads: made
// and ended by the control thread, which takes requests when fd() is readable; counters() by any.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

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

// What a reply to a command_t says again.
struct LcmCommand {
  std::int64_t utime_us = 0;
  std::int8_t command = 0;
  // A command that comes again with the same utime is the same request; without one it is another.
  [[nodiscard]] std::string id() const;
};

struct LcmRequest {
  ControlRequest request;
  std::optional<LcmCommand> command;  // nothing: a trigger, which nobody answers
  Status status;                      // of a command: why it cannot be done
};

// A reply_t. `utime_us` is now.
[[nodiscard]] std::vector<std::byte> encode_command_reply(const LcmCommand& command, const ControlReply& reply,
                                                          const Uuid& cart, const Uuid& run, std::int64_t utime_us);

class LcmRequests {
 public:
  // Throws std::system_error where there is no descriptor. Without a network it tries again now and then.
  explicit LcmRequests(const LcmConfiguration& configuration);
  LcmRequests(const LcmRequests&) = delete;
  LcmRequests& operator=(const LcmRequests&) = delete;
  ~LcmRequests();

  [[nodiscard]] int fd() const { return fd_; }
  // The next request in order of coming.
  [[nodiscard]] std::optional<LcmRequest> take();
  [[nodiscard]] LcmInputCounters counters() const;

  // For the thread and for tests. Errors: kCorrupt; of a trigger kInvalidArgument, too: a command has its status.
  [[nodiscard]] static Expected<LcmRequest> decode_trigger(std::span<const std::byte> bytes);
  [[nodiscard]] static Expected<LcmRequest> decode_command(std::span<const std::byte> bytes);

 private:
  void subscribe(lcm::LCM& network);
  void on_message(Expected<LcmRequest> request);

  const LcmConfiguration configuration_;
  const int fd_;
  std::atomic<std::uint64_t> taken_{0};
  std::atomic<std::uint64_t> bad_{0};
  std::atomic<std::uint64_t> dropped_{0};
  Mutex mutex_;
  std::deque<LcmRequest> requests_ GUARDED_BY(mutex_);
  std::optional<LcmListener> listener_;
};

}  // namespace submapd
