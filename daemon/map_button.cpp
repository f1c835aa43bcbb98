#include "daemon/map_button.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/input.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

namespace submapd {
namespace {

constexpr std::int32_t kPress = 1;  // 0: release, 2: repeat

}  // namespace

MapButton::MapButton(EventLoop& loop, const ButtonConfiguration& configuration, std::function<void()> pressed)
    : loop_(loop), configuration_(configuration), pressed_(std::move(pressed)) {
  look();
}

MapButton::~MapButton() {
  shut();
}

void MapButton::configure(const ButtonConfiguration& configuration) {
  shut();
  trouble_.clear();
  configuration_ = configuration;
  look();
}

void MapButton::look() {
  if (fd_ >= 0 || configuration_.device.empty()) return;
  fd_ = ::open(configuration_.device.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) {
    trouble_ = fmt::format("button {}: {}", configuration_.device, std::strerror(errno));
    return;
  }
  (void)::ioctl(fd_, EVIOCGRAB, 1);  // refused if it is no input device, e.g. a pipe that a script writes to
  if (Status status = loop_.add(fd_, EPOLLIN, [this](std::uint32_t) { on_events(); }); !status.ok()) {
    trouble_ = fmt::format("button {}: it cannot be waited for", configuration_.device);  // a regular file
    ::close(std::exchange(fd_, -1));
    return;
  }
  trouble_.clear();
}

void MapButton::shut() {
  if (fd_ < 0) return;
  loop_.remove(fd_);
  ::close(std::exchange(fd_, -1));
}

void MapButton::on_events() {
  std::array<input_event, 16> events{};
  const ssize_t size = ::read(fd_, events.data(), sizeof events);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size <= 0 || static_cast<std::size_t>(size) % sizeof(input_event) != 0) {  // unplugged, or no input device
    trouble_ = fmt::format("button {}: it has gone", configuration_.device);
    return shut();
  }
  bool pressed = false;
  for (std::size_t i = 0; i < static_cast<std::size_t>(size) / sizeof(input_event); ++i) {
    pressed =
        pressed || (events[i].type == EV_KEY && events[i].code == configuration_.key && events[i].value == kPress);
  }
  if (pressed) pressed_();
}

}  // namespace submapd
