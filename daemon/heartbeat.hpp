// Whether a thread still moves: it beats in its loop, the control thread looks before it feeds the watchdog.
#pragma once

#include <atomic>
#include <cstdint>

namespace submapd {

class Heartbeat {
 public:
  // The thread itself; neither blocks nor orders anything.
  void beat() noexcept { beats_.fetch_add(1, std::memory_order_relaxed); }
  // Any thread.
  [[nodiscard]] std::uint64_t beats() const noexcept { return beats_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> beats_{0};
};

// Remembers the beats it saw last. One thread.
class HeartbeatWatch {
 public:
  // REQUIRES: heartbeat outlives the watch.
  explicit HeartbeatWatch(const Heartbeat& heartbeat) : heartbeat_(&heartbeat) {}
  // True if the thread moved since the last note().
  [[nodiscard]] bool moved() const { return heartbeat_->beats() != seen_; }
  void note() { seen_ = heartbeat_->beats(); }

 private:
  const Heartbeat* heartbeat_;
  std::uint64_t seen_ = 0;
};

}  // namespace submapd
