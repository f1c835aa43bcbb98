#include "daemon/event_loop.hpp"

#include <fmt/format.h>
#include <sys/epoll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "driver/monotonic.hpp"

namespace submapd {

EventLoop::EventLoop() : epoll_(::epoll_create1(EPOLL_CLOEXEC)) {
  if (epoll_ < 0) throw std::system_error(errno, std::generic_category(), "epoll_create1");
}

EventLoop::~EventLoop() {
  ::close(epoll_);
}

Status EventLoop::add(int fd, std::uint32_t events, Callback callback) {
  epoll_event event{};
  event.events = events;
  event.data.fd = fd;
  if (::epoll_ctl(epoll_, EPOLL_CTL_ADD, fd, &event) != 0) {
    return {StatusCode::kIo, fmt::format("cannot wait for descriptor {}: {}", fd, std::strerror(errno))};
  }
  callbacks_[fd] = std::make_shared<Callback>(std::move(callback));
  return {};
}

void EventLoop::remove(int fd) {
  if (callbacks_.erase(fd) > 0) ::epoll_ctl(epoll_, EPOLL_CTL_DEL, fd, nullptr);
}

Status EventLoop::run() {
  std::array<epoll_event, 16> events{};
  while (!stopped_) {
    const int count = ::epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), -1);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return {StatusCode::kIo, fmt::format("epoll_wait: {}", std::strerror(errno))};
    const std::int64_t woken_ns = driver::monotonic_now_ns();
    for (int i = 0; i < count && !stopped_; ++i) {
      const epoll_event& event = events[static_cast<std::size_t>(i)];
      const auto found = callbacks_.find(event.data.fd);
      if (found == callbacks_.end()) continue;  // removed by an earlier callback of this round
      const std::shared_ptr<Callback> callback = found->second;
      (*callback)(event.events);
    }
    longest_turn_ns_ = std::max(longest_turn_ns_, driver::monotonic_now_ns() - woken_ns);
  }
  return {};
}

}  // namespace submapd
