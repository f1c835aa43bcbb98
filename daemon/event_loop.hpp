// Waits for descriptors and calls who is interested: the control thread's loop (epoll).
//
// One thread. A callback may add and remove descriptors, its own too.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>

#include "slam/base/status.hpp"

namespace submapd {

class EventLoop {
 public:
  using Callback = std::function<void(std::uint32_t events)>;  // EPOLLIN, EPOLLOUT, ...

  // Throws std::system_error: for start-up.
  EventLoop();
  EventLoop(const EventLoop&) = delete;
  EventLoop& operator=(const EventLoop&) = delete;
  ~EventLoop();

  // The descriptor stays the caller's, who removes it before closing it.
  [[nodiscard]] Status add(int fd, std::uint32_t events, Callback callback);
  void remove(int fd);

  // Until stop() is called by a callback. Errors: kIo.
  [[nodiscard]] Status run();
  void stop() { stopped_ = true; }
  // The longest time between two waits so far: how long somebody else may have waited.
  [[nodiscard]] std::int64_t longest_turn_ns() const { return longest_turn_ns_; }

 private:
  int epoll_;
  bool stopped_ = false;
  std::int64_t longest_turn_ns_ = 0;
  std::map<int, std::shared_ptr<Callback>> callbacks_;
};

}  // namespace submapd
