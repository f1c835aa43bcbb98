// Emulated scanners behind a TCP port that speaks USB/IP, for a kernel with vhci-hcd: usbip attach -r HOST -b 1-1.
//
// One thread, the caller's: run() serves until stop(). Listens on the loopback address only, as USB/IP knows no
// passwords. A client that breaks the protocol is told off on stderr, counted, and its connection closed.
#pragma once

#include <atomic>
#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include "slam/base/status.hpp"
#include "tools/hokuyo_sim/usbip_session.hpp"

namespace submapd::tools {

class UsbipFront {
 public:
  static constexpr std::size_t kMostConnections = 16;

  // port 0: any that is free. REQUIRES: the sensors outlive the front; they get ports 1-1, 1-2, ...
  [[nodiscard]] static Expected<std::unique_ptr<UsbipFront>> open(std::uint16_t port,
                                                                  const std::vector<driver::SimSensor*>& sensors);
  UsbipFront(const UsbipFront&) = delete;
  UsbipFront& operator=(const UsbipFront&) = delete;
  ~UsbipFront();

  [[nodiscard]] std::uint16_t port() const { return port_; }
  // Powers the sensors on and serves them until `stop` is true; looks at least every 100 ms.
  void run(const std::atomic<bool>& stop);

 private:
  struct Connection {
    Connection(int fd, std::span<UsbipExport> exports) : socket(fd), session(exports) {}
    int socket;
    UsbipSession session;
    bool ended = false;  // by the client or by an error of the socket
  };

  explicit UsbipFront(int listener) : listener_(listener) {}
  void wait(std::int64_t until_ns);
  void accept_client();
  void read(Connection& connection);
  void write(Connection& connection);
  void close_ended();

  int listener_;
  std::uint16_t port_ = 0;
  std::vector<driver::SimSensor*> sensors_;
  std::vector<UsbipExport> exports_;
  std::list<Connection> connections_;
  std::uint64_t errors_ = 0;  // clients that broke the protocol
};

}  // namespace submapd::tools
