// Lets a thread sleep until those that work off its queues have made room, at no cost to them while it does not sleep.
//
// One sleeper; any number of threads that make room, real-time ones too: ring() takes no lock, and calls the kernel
// only when somebody sleeps.
#pragma once

#include <atomic>
#include <chrono>

#include "driver/ring/doorbell.hpp"

namespace submapd {

class RoomBell {
 public:
  explicit RoomBell(driver::Doorbell& bell) : bell_(bell) {}

  // After something was taken out. The rings' own pop() is a release store, the doorbell wants more (Doorbell::wait()):
  // of two threads that each write, fence and read, one at least reads what the other wrote.
  void ring() noexcept {
    std::atomic_thread_fence(std::memory_order_seq_cst);
    bell_.ring();
  }
  // True as soon as has_room() is true, false if it is not after `timeout`.
  template <typename HasRoom>
  bool wait(HasRoom&& has_room, std::chrono::milliseconds timeout) noexcept {
    return bell_.wait(
        [&has_room] {
          std::atomic_thread_fence(std::memory_order_seq_cst);
          return has_room();
        },
        timeout);
  }

 private:
  driver::Doorbell& bell_;
};

}  // namespace submapd
