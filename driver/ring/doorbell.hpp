// Lets a consumer sleep until a producer has something for it, at no cost to the producer while nobody sleeps.
//
// One sleeper; any number of producers, e.g. several rings that one thread reads. A producer calls ring() after it has
// published: one atomic load if the sleeper is awake, one write to an eventfd (never blocks, takes no lock of ours) if
// it sleeps. No wake-up is lost: the argument is at wait().
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <tl/expected.hpp>
#include <utility>

#include "driver/error.hpp"

namespace submapd::driver {

// Counter of the kernel: wake() adds to it, sleep() waits until it is not zero and zeroes it.
class EventFd {
 public:
  [[nodiscard]] static Expected<EventFd> open();
  EventFd(EventFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  EventFd& operator=(EventFd&&) = delete;
  ~EventFd();

  void wake() noexcept;
  // False: the time is over, or a signal came.
  bool sleep(std::chrono::milliseconds timeout) noexcept;

 private:
  explicit EventFd(int fd) : fd_(fd) {}
  int fd_;
};

// Atomic and Sleeper are parameters so that the model check (tests/unit/driver/ring) runs this very code.
template <template <typename> class Atomic, typename Sleeper>
class BasicDoorbell {
 public:
  explicit BasicDoorbell(Sleeper sleeper) : sleeper_(std::move(sleeper)) {}

  // Producers, after they made their work visible by a seq_cst store. Never blocks.
  void ring() noexcept {
    // seq_cst: see wait(). Only the producer that takes the mark away writes to the kernel: one call for each sleep.
    if (sleeping_.load(std::memory_order_seq_cst) != 0 && sleeping_.exchange(0, std::memory_order_seq_cst) != 0) {
      sleeper_.wake();
    }
  }

  // The consumer: true as soon as has_work() is true, false if it is not after `timeout` (or after a signal).
  // REQUIRES: has_work() reads by seq_cst loads what the producers write by seq_cst stores.
  //
  // A producer stores its work, then loads the mark; the sleeper stores the mark, then loads the work. All four are
  // seq_cst, hence in one total order: whichever store comes second, the load behind it sees the other's store. Either
  // the sleeper sees the work or the producer sees the mark; both stale, the lost wake-up, is impossible. Release and
  // acquire would not do: both loads could then be taken before both stores.
  template <typename HasWork>
  bool wait(HasWork&& has_work, std::chrono::milliseconds timeout) noexcept {
    if (has_work()) return true;
    const auto until = std::chrono::steady_clock::now() + timeout;
    for (;;) {
      sleeping_.store(1, std::memory_order_seq_cst);
      const bool work = has_work();
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
      // A producer that took the mark already has counted the event up: the next sleep ends at once, which only costs
      // one more look.
      const bool woken = !work && left.count() > 0 && sleeper_.sleep(left);
      sleeping_.store(0, std::memory_order_relaxed);
      if (work || has_work()) return true;
      if (!woken) return false;
    }
  }

 private:
  alignas(64) Atomic<std::uint32_t> sleeping_{0};
  Sleeper sleeper_;
};

using Doorbell = BasicDoorbell<std::atomic, EventFd>;

}  // namespace submapd::driver
