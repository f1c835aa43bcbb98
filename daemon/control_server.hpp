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

// All monotonic.
struct ControlServerCounters {
  std::uint64_t turned_away = 0;  // there were too many
  std::uint64_t shut_out = 0;     // idle, too long a packet, or did not read its replies
};

struct ControlServerOptions {
  std::string path;
  std::string group;  // empty: the process's
  std::size_t most_clients = 16;
  std::int64_t idle_ns = 30'000'000'000;
  std::int64_t patience_ns = 1'000'000'000;  // idle so long, a client makes room for the next if there are too many
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

  // One more packet to a client, if it is still there; with an open file, which stays the caller's, if `file` >= 0.
  void send(std::uint64_t client, const std::string& packet, int file = -1);
  // A client that waits is not idle.
  void keep(std::uint64_t client, bool waits);
  // Shuts out who has been idle too long.
  void look(std::int64_t now_ns);

  [[nodiscard]] std::size_t clients() const { return clients_.size(); }
  [[nodiscard]] const ControlServerCounters& counters() const { return counters_; }

 private:
  struct Client {
    int fd = -1;
    ControlPeer peer;
    std::int64_t heard_ns = 0;
    bool waits = false;
  };
  ControlServer(EventLoop& loop, ControlServerOptions options, Handler handler, int fd);
  void accept_one();
  void make_room(std::int64_t now_ns);
  void serve(std::uint64_t id);
  void shut_out(std::uint64_t id);
  void shut(std::uint64_t id);

  EventLoop& loop_;
  const ControlServerOptions options_;
  const Handler handler_;
  const int fd_;
  std::map<std::uint64_t, Client> clients_;
  std::uint64_t next_client_ = 1;
  ControlServerCounters counters_;
};

}  // namespace submapd
