#include "driver/ring/doorbell.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <system_error>

namespace submapd::driver {

Expected<EventFd> EventFd::open() {
  const int fd = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (fd < 0) return failure(ErrorCode::kSystem, "eventfd: " + std::generic_category().message(errno));
  return EventFd(fd);
}

EventFd::~EventFd() {
  if (fd_ >= 0) ::close(fd_);
}

void EventFd::wake() noexcept {
  // Fails only if 2^64 - 2 wake-ups are pending: then the sleeper is awake anyway.
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(fd_, &one, sizeof(one));
}

bool EventFd::sleep(std::chrono::milliseconds timeout) noexcept {
  pollfd events{fd_, POLLIN, 0};
  const auto longest = static_cast<std::chrono::milliseconds::rep>(std::numeric_limits<int>::max());
  if (::poll(&events, 1, static_cast<int>(std::clamp(timeout.count(), decltype(longest){0}, longest))) <= 0)
    return false;
  std::uint64_t count = 0;
  return ::read(fd_, &count, sizeof(count)) == sizeof(count);
}

}  // namespace submapd::driver
