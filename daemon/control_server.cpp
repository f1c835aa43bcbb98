#include "daemon/control_server.hpp"

#include <fmt/format.h>
#include <grp.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

#include "daemon/control_protocol.hpp"
#include "driver/monotonic.hpp"

namespace submapd {
namespace {

constexpr int kBacklog = 16;

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  return address;
}

Status error_of(const std::string& path, const char* step) {
  const StatusCode code = errno == EADDRINUSE ? StatusCode::kUnavailable : StatusCode::kIo;
  return {code, fmt::format("control socket {}: cannot {}: {}", path, step, std::strerror(errno))};
}

// Removes a socket that a daemon before us left. One that answers is left alone.
Status remove_stale(const std::string& path, const sockaddr_un& address) {
  struct stat info {};
  if (::lstat(path.c_str(), &info) != 0) return {};
  if (!S_ISSOCK(info.st_mode))
    return {StatusCode::kIo, fmt::format("control socket {}: something else is there", path)};
  const int probe = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool answers = probe >= 0 && ::connect(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  if (probe >= 0) ::close(probe);
  if (answers) {
    return {StatusCode::kUnavailable, fmt::format("control socket {}: another submapd answers there", path)};
  }
  ::unlink(path.c_str());
  return {};
}

Status set_access(const ControlServerOptions& options) {
  if (!options.group.empty()) {
    std::vector<char> store(16'384);
    group entry{};
    group* found = nullptr;
    ::getgrnam_r(options.group.c_str(), &entry, store.data(), store.size(), &found);
    if (found == nullptr) {
      return {StatusCode::kInvalidArgument, fmt::format("control socket: there is no group {}", options.group)};
    }
    if (::chown(options.path.c_str(), static_cast<uid_t>(-1), found->gr_gid) != 0) {
      return error_of(options.path, "give it to the group");
    }
  }
  return ::chmod(options.path.c_str(), 0660) == 0 ? Status() : error_of(options.path, "set its mode");
}

}  // namespace

Expected<std::unique_ptr<ControlServer>> ControlServer::open(EventLoop& loop, ControlServerOptions options,
                                                             Handler handler) {
  const sockaddr_un address = address_of(options.path);
  std::error_code ignored;
  std::filesystem::create_directories(std::filesystem::path(options.path).parent_path(), ignored);
  if (Status status = remove_stale(options.path, address); !status.ok()) return failure(status);
  const int fd = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return failure(error_of(options.path, "make it"));
  const mode_t mask = ::umask(0177);  // nobody else until the group is set
  const bool bound = ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  ::umask(mask);
  Status status = bound ? set_access(options) : error_of(options.path, "bind it");
  if (status.ok() && ::listen(fd, kBacklog) != 0) status = error_of(options.path, "listen");
  if (!status.ok()) {
    ::close(fd);
    return failure(status);
  }
  std::unique_ptr<ControlServer> server(new ControlServer(loop, std::move(options), std::move(handler), fd));
  ControlServer* const self = server.get();
  status = loop.add(fd, EPOLLIN, [self](std::uint32_t) { self->accept_one(); });
  if (!status.ok()) return failure(status);
  return server;
}

ControlServer::ControlServer(EventLoop& loop, ControlServerOptions options, Handler handler, int fd)
    : loop_(loop), options_(std::move(options)), handler_(std::move(handler)), fd_(fd) {}

ControlServer::~ControlServer() {
  while (!clients_.empty()) shut(clients_.begin()->first);
  loop_.remove(fd_);
  ::close(fd_);
  ::unlink(options_.path.c_str());
}

// Else a few silent clients could keep the operator out.
void ControlServer::make_room(std::int64_t now_ns) {
  const auto idlest = std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
    return std::pair(a.second.waits, a.second.heard_ns) < std::pair(b.second.waits, b.second.heard_ns);
  });
  if (idlest == clients_.end() || idlest->second.waits) return;
  if (now_ns - idlest->second.heard_ns > options_.patience_ns) shut_out(idlest->first);
}

void ControlServer::accept_one() {
  const int fd = ::accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
  if (fd < 0) return;
  ucred credentials{};
  socklen_t size = sizeof credentials;
  ::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &credentials, &size);
  if (clients_.size() >= options_.most_clients) make_room(driver::monotonic_now_ns());
  const std::uint64_t id = next_client_++;
  const auto on_packet = [this, id](std::uint32_t) { serve(id); };
  if (clients_.size() >= options_.most_clients || !loop_.add(fd, EPOLLIN, on_packet).ok()) {
    ++counters_.turned_away;
    const std::string busy = encode_reply(refusal("", {StatusCode::kUnavailable, "too many clients; try again"}));
    (void)!::send(fd, busy.data(), busy.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    ::close(fd);
    return;
  }
  clients_[id] = {fd, {id, credentials.pid, credentials.uid}, driver::monotonic_now_ns(), false};
}

void ControlServer::serve(std::uint64_t id) {
  const auto found = clients_.find(id);
  if (found == clients_.end()) return;
  std::array<char, kMaxRequestBytes> packet{};
  // MSG_TRUNC: the packet's size, though only what fits is copied.
  const ssize_t size = ::recv(found->second.fd, packet.data(), packet.size(), MSG_DONTWAIT | MSG_TRUNC);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size <= 0) return shut(id);
  found->second.heard_ns = driver::monotonic_now_ns();
  const ControlPeer peer = found->second.peer;
  if (static_cast<std::size_t>(size) > packet.size()) {
    send(id, encode_reply(refusal("", {StatusCode::kInvalidArgument, "the request is too long"})));
    return shut_out(id);
  }
  const std::string answer = handler_({packet.data(), static_cast<std::size_t>(size)}, peer);
  if (!answer.empty()) send(id, answer);
}

void ControlServer::send(std::uint64_t client, const std::string& packet, int file) {
  const auto found = clients_.find(client);
  if (found == clients_.end()) return;
  iovec text{const_cast<char*>(packet.data()), packet.size()};
  msghdr message{};
  message.msg_iov = &text;
  message.msg_iovlen = 1;
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof file)> rights{};
  if (file >= 0) {
    message.msg_control = rights.data();
    message.msg_controllen = rights.size();
    cmsghdr* const header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof file);
    std::memcpy(CMSG_DATA(header), &file, sizeof file);
  }
  const ssize_t sent = ::sendmsg(found->second.fd, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
  if (sent != static_cast<ssize_t>(packet.size())) shut_out(client);
}

void ControlServer::keep(std::uint64_t client, bool waits) {
  const auto found = clients_.find(client);
  if (found == clients_.end()) return;
  found->second.waits = waits;
  found->second.heard_ns = driver::monotonic_now_ns();
}

void ControlServer::look(std::int64_t now_ns) {
  std::vector<std::uint64_t> idle;
  for (const auto& [id, client] : clients_) {
    if (!client.waits && now_ns - client.heard_ns > options_.idle_ns) idle.push_back(id);
  }
  for (const std::uint64_t id : idle) shut_out(id);
}

void ControlServer::shut_out(std::uint64_t id) {
  if (clients_.contains(id)) ++counters_.shut_out;
  shut(id);
}

void ControlServer::shut(std::uint64_t id) {
  const auto found = clients_.find(id);
  if (found == clients_.end()) return;
  loop_.remove(found->second.fd);
  ::close(found->second.fd);
  clients_.erase(found);
}

}  // namespace submapd
