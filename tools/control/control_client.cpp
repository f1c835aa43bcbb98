#include "tools/control/control_client.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

namespace submapd::tools {
namespace {

constexpr std::size_t kMaxReply_bytes = 65'536;
constexpr std::chrono::milliseconds kPatience{5000};

}  // namespace

Expected<ControlClient> ControlClient::connect(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) {
    return failure(StatusCode::kInvalidArgument, fmt::format("{}: too long for a socket", path));
  }
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  ControlClient client(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
  if (client.fd_ >= 0 && ::connect(client.fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
    return client;
  }
  if (errno == EACCES) {
    return failure(StatusCode::kIo, fmt::format("may not use {}: be in its group, or root", path));
  }
  return failure(StatusCode::kUnavailable,
                 fmt::format("no submapd answers at {}: {}; is it running?", path, std::strerror(errno)));
}

ControlClient::ControlClient(ControlClient&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), file_(std::exchange(other.file_, -1)) {}

ControlClient::~ControlClient() {
  if (fd_ >= 0) ::close(fd_);
  if (file_ >= 0) ::close(file_);
}

Status ControlClient::send(const nlohmann::json& request) {
  const std::string packet = request.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  if (::send(fd_, packet.data(), packet.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(packet.size())) return {};
  return {StatusCode::kUnavailable, fmt::format("submapd does not listen: {}", std::strerror(errno))};
}

Expected<nlohmann::json> ControlClient::receive(std::chrono::milliseconds patience) {
  pollfd poll_fd{fd_, POLLIN, 0};
  if (::poll(&poll_fd, 1, static_cast<int>(patience.count())) <= 0) {
    return failure(StatusCode::kUnavailable,
                   fmt::format("no answer from submapd within {} s", patience.count() / 1000));
  }
  std::vector<char> packet(kMaxReply_bytes);
  iovec text{packet.data(), packet.size()};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof file_)> rights{};
  msghdr message{};
  message.msg_iov = &text;
  message.msg_iovlen = 1;
  message.msg_control = rights.data();
  message.msg_controllen = rights.size();
  const ssize_t size = ::recvmsg(fd_, &message, MSG_CMSG_CLOEXEC);
  const cmsghdr* const header = size > 0 ? CMSG_FIRSTHDR(&message) : nullptr;
  if (header != nullptr && header->cmsg_level == SOL_SOCKET && header->cmsg_type == SCM_RIGHTS) {
    if (const int old = take_file(); old >= 0) ::close(old);
    std::memcpy(&file_, CMSG_DATA(header), sizeof file_);
  }
  if (size <= 0) return failure(StatusCode::kUnavailable, "submapd has closed the connection");
  nlohmann::json reply = nlohmann::json::parse(packet.begin(), packet.begin() + size, nullptr, false);
  if (!reply.is_object()) return failure(StatusCode::kInternal, "submapd's answer is none");
  return reply;
}

int ControlClient::take_file() {
  return std::exchange(file_, -1);
}

Expected<nlohmann::json> ControlClient::ask(const nlohmann::json& request) {
  if (Status status = send(request); !status.ok()) return failure(status);
  return receive(kPatience);
}

std::string text_of(const nlohmann::json& reply, const char* key) {
  const auto found = reply.find(key);
  return found != reply.end() && found->is_string() ? found->get<std::string>() : std::string();
}

}  // namespace submapd::tools
