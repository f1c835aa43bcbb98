#include "tools/hokuyo_sim/usbip_front.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <utility>

#include "driver/monotonic.hpp"

namespace submapd::tools {
namespace {

constexpr std::int64_t kLongestWait_ns = 100'000'000;
// A client that does not take its answers is not asked for more.
constexpr std::size_t kMostOutput = 1 << 20;

}  // namespace

UsbipFront::~UsbipFront() {
  for (const Connection& connection : connections_) {
    ::close(connection.socket);
  }
  ::close(listener_);
}

Expected<std::unique_ptr<UsbipFront>> UsbipFront::open(std::uint16_t port,
                                                       const std::vector<driver::SimSensor*>& sensors) {
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (listener < 0) {
    return failure(StatusCode::kIo, fmt::format("cannot open a socket: {}", std::strerror(errno)));
  }
  std::unique_ptr<UsbipFront> front(new UsbipFront(listener));
  const int on = 1;
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  if (setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) != 0 || ::bind(listener, generic, size) != 0 ||
      ::listen(listener, 4) != 0 || getsockname(listener, generic, &size) != 0) {
    return failure(StatusCode::kIo, fmt::format("cannot listen on 127.0.0.1:{}: {}", port, std::strerror(errno)));
  }
  front->port_ = ntohs(address.sin_port);
  front->sensors_ = sensors;
  for (driver::SimSensor* const sensor : sensors) {
    UsbipDeviceInfo info;
    info.address = static_cast<std::uint32_t>(2 + front->exports_.size());
    info.busid = fmt::format("1-{}", 1 + front->exports_.size());
    front->exports_.emplace_back(std::move(info), *sensor);
  }
  return front;
}

void UsbipFront::run(const std::atomic<bool>& stop) {
  for (driver::SimSensor* const sensor : sensors_) {
    sensor->power_on(driver::monotonic_now_ns());
  }
  while (!stop) {
    std::int64_t next_ns = driver::monotonic_now_ns() + kLongestWait_ns;
    for (UsbipExport& scanner : exports_) {
      scanner.serve(driver::monotonic_now_ns());
      next_ns = std::min(next_ns, scanner.next_event_ns());
    }
    for (Connection& connection : connections_) {
      write(connection);
    }
    close_ended();
    wait(next_ns);
  }
}

void UsbipFront::wait(std::int64_t until_ns) {
  std::vector<pollfd> watched;
  // A client beyond the most waits in the kernel's queue.
  watched.push_back({listener_, static_cast<short>(connections_.size() < kMostConnections ? POLLIN : 0), 0});
  for (Connection& connection : connections_) {
    const std::size_t waiting = connection.session.output().size();
    const int events = (waiting < kMostOutput ? POLLIN : 0) | (waiting > 0 ? POLLOUT : 0);
    watched.push_back({connection.socket, static_cast<short>(events), 0});
  }
  const timespec timeout{0, std::clamp<std::int64_t>(until_ns - driver::monotonic_now_ns(), 0, kLongestWait_ns)};
  if (ppoll(watched.data(), watched.size(), &timeout, nullptr) <= 0) {
    return;
  }
  auto polled = watched.begin() + 1;
  for (Connection& connection : connections_) {
    if ((polled++->revents & (POLLIN | POLLERR | POLLHUP)) != 0) {
      read(connection);
    }
  }
  if (watched.front().revents != 0) {
    accept_client();
  }
}

void UsbipFront::accept_client() {
  const int client = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (client < 0) {
    return;
  }
  const int on = 1;
  setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  connections_.emplace_back(client, exports_);
}

void UsbipFront::read(Connection& connection) {
  std::array<std::uint8_t, 16'384> bytes{};
  const ssize_t length = ::recv(connection.socket, bytes.data(), bytes.size(), 0);
  if (length > 0) {
    static_cast<void>(
        connection.session.receive(driver::monotonic_now_ns(), {bytes.data(), static_cast<std::size_t>(length)}));
  } else if (length == 0 || (errno != EAGAIN && errno != EINTR)) {
    connection.ended = true;
  }
}

void UsbipFront::write(Connection& connection) {
  std::vector<std::uint8_t>& output = connection.session.output();
  while (!output.empty() && !connection.ended) {
    const ssize_t length = ::send(connection.socket, output.data(), output.size(), MSG_NOSIGNAL);
    if (length < 0) {
      connection.ended = errno != EAGAIN && errno != EINTR;
      return;
    }
    output.erase(output.begin(), output.begin() + length);
  }
}

void UsbipFront::close_ended() {
  std::erase_if(connections_, [this](const Connection& connection) {
    if (connection.session.error() != UsbipError::kNone) {
      fmt::print(stderr, "hokuyo-sim: USB/IP client {} ({} so far); its connection is closed\n",
                 words_of(connection.session.error()), ++errors_);
    }
    const bool over = connection.ended || connection.session.over();
    if (over) {
      ::close(connection.socket);
    }
    return over;
  });
}

}  // namespace submapd::tools
