#include "tools/hokuyo_sim/pty_front.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <utility>

#include "driver/monotonic.hpp"

namespace submapd::tools {

PtyFront::PtyFront(driver::SimSensor& sensor, int master, int slave, std::string path)
    : sensor_(sensor), master_(master), slave_(slave), path_(std::move(path)) {}

PtyFront::PtyFront(PtyFront&& other) noexcept
    : sensor_(other.sensor_),
      master_(std::exchange(other.master_, -1)),
      slave_(std::exchange(other.slave_, -1)),
      path_(std::move(other.path_)) {}

PtyFront::~PtyFront() {
  for (const int fd : {master_, slave_}) {
    if (fd >= 0) {
      close(fd);
    }
  }
}

Expected<PtyFront> PtyFront::open(driver::SimSensor& sensor) {
  const auto failed = [] {
    return failure(StatusCode::kIo, fmt::format("cannot open a pseudo-terminal: {}", std::strerror(errno)));
  };
  const int master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (master < 0) {
    return failed();
  }
  PtyFront front(sensor, master, -1, "");
  std::array<char, 128> name{};
  if (grantpt(master) != 0 || unlockpt(master) != 0 || ptsname_r(master, name.data(), name.size()) != 0) {
    return failed();
  }
  front.path_ = name.data();
  front.slave_ = ::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  termios settings{};
  if (front.slave_ < 0 || tcgetattr(front.slave_, &settings) != 0) {
    return failed();
  }
  cfmakeraw(&settings);
  if (tcsetattr(front.slave_, TCSANOW, &settings) != 0) {
    return failed();
  }
  return front;
}

void PtyFront::run(const std::atomic<bool>& stop) {
  sensor_.power_on(driver::monotonic_now_ns());
  while (!stop) {
    while (const auto output = sensor_.take(driver::monotonic_now_ns())) {
      // A reader that does not keep up loses bytes, as with a real line.
      static_cast<void>(write(master_, output->bytes.data(), output->bytes.size()));
    }
    constexpr std::int64_t kLongest_ns = 100'000'000;
    const std::int64_t wait_ns =
        std::clamp<std::int64_t>(sensor_.next_event_ns() - driver::monotonic_now_ns(), 0, kLongest_ns);
    pollfd readable{master_, POLLIN, 0};
    const timespec timeout{0, wait_ns};
    if (ppoll(&readable, 1, &timeout, nullptr) > 0 && (readable.revents & POLLIN) != 0) {
      std::array<std::uint8_t, 256> bytes{};
      const ssize_t length = read(master_, bytes.data(), bytes.size());
      if (length > 0) {
        sensor_.receive(driver::monotonic_now_ns(), {bytes.data(), static_cast<std::size_t>(length)});
      }
    }
  }
}

}  // namespace submapd::tools
