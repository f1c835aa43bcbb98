// The control socket: takes packets from local clients, has them answered, keeps them within bounds.
//
// On the event loop's thread; never blocks. A client that does not read what it is sent is shut out.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "daemon/event_loop.hpp"
#include "slam/base/status.hpp"

namespace submapd {

struct ControlServerOptions {
  std::string path;
  std::string group;  // empty: the process's
  std::size_t most_clients = 16;
  std::int64_t idle_ns = 30'000'000'000;
};

// Who asks, by the kernel's word.
struct ControlPeer {
  std::uint64_t client = 0;  // for send()
  pid_t pid = 0;
  uid_t uid = 0;
};

class ControlServer {
 public:
  // Answers a packet; an empty answer sends nothing.
  using Handler = std::function<std::string(std::string_view packet, const ControlPeer& peer)>;

  // Makes the socket; an old one that nobody answers on is replaced. Errors: kIo, kInvalidArgument (no such group),
  // kUnavailable (another daemon has it).
  [[nodiscard]] static Expected<std::unique_ptr<ControlServer>> open(EventLoop& loop, ControlServerOptions options,
                                                                     Handler handler);
  ControlServer(const ControlServer&) = delete;
  ControlServer& operator=(const ControlServer&) = delete;
  ~ControlServer();

  // One more packet to a client, if it is still there.
  void send(std::uint64_t client, const std::string& packet);
  // A client that waits is not idle.
  void keep(std::uint64_t client, bool waits);
  // Shuts out who has been idle too long.
  void look(std::int64_t now_ns);

  [[nodiscard]] std::size_t clients() const { return clients_.size(); }
  [[nodiscard]] std::uint64_t turned_away() const { return turned_away_; }

 private:
  struct Client {
    int fd = -1;
    ControlPeer peer;
    std::int64_t heard_ns = 0;
    bool waits = false;
  };
  ControlServer(EventLoop& loop, ControlServerOptions options, Handler handler, int fd);
  void accept_one();
  void serve(std::uint64_t id);
  void shut(std::uint64_t id);

  EventLoop& loop_;
  const ControlServerOptions options_;
  const Handler handler_;
  const int fd_;
  std::map<std::uint64_t, Client> clients_;
  std::uint64_t next_client_ = 1;
  std::uint64_t turned_away_ = 0;
};

}  // namespace submapd
