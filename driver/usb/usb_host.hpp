// Finds scanners on USB, keeps their lines open, and runs the one thread on which all their bytes arrive.
//
// A scanner is a CDC-ACM device with a known VID:PID; endpoints come from its descriptors. For each one that appears
// the client factory is asked for a client; the line is then opened, stays open while the device is there, and is
// opened again (with growing patience, up to 10 s) when opening fails. Devices come and go by hotplug; nothing is
// polled.
//
// Threads: run() is the event thread and calls everything of LinkClient and UsbClients; stop() may be called from any
// thread. From a transfer's completion to LinkClient::on_bytes this code neither allocates nor locks nor logs; libusb
// itself allocates a constant amount when a transfer is submitted again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "driver/error.hpp"
#include "driver/link.hpp"

namespace submapd::driver {

struct UsbId {
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
};

struct UsbOptions {
  std::vector<UsbId> ids = {{0x15d1, 0x0000}};  // all URG, UTM, UXM and UTX scanners share this one
  // 16 of 4096 bytes hold half a second of MD. A transfer ends with a short packet, hence with the scan at the latest.
  // Smaller ones tell a scan's first bytes sooner, but each costs a submission and a wake-up (shown by
  // tests/soak/scanners_soak.py --transfer-bytes), and the clock learns the constant delay anyway. REQUIRES: bytes a
  // multiple of 64, else full packets overflow.
  std::size_t transfers = 16;
  std::size_t transfer_bytes = 4096;
  std::size_t max_scanners = 4;  // further ones are reported and left alone
};

// What is known of a device before anything was asked of it.
struct UsbPort {
  std::string path;  // bus and port chain as the kernel names it, e.g. "1-1.2": stays the same while nobody re-plugs
  std::uint8_t address = 0;
  UsbId id;
};

// Bytes and trouble of one line since the device appeared.
struct UsbCounters {
  std::uint64_t bytes_in = 0;
  std::uint64_t transfers_in = 0;
  std::uint64_t stalls = 0;
  std::uint64_t overflows = 0;
  std::uint64_t errors = 0;
  std::uint64_t writes_failed = 0;
};

// Who speaks with the scanners. All calls on the event thread.
class UsbClients {
 public:
  // A scanner is plugged in. The client must stay valid until gone() returns. nullptr: leave it alone.
  virtual LinkClient* arrived(const UsbPort& port) = 0;
  // It cannot be opened; tried again later if that makes sense. Said once per reason.
  virtual void cannot_open(const UsbPort& port, const Error& error) = 0;
  // Unplugged; on_close() was called before if the line was open.
  virtual void gone(const UsbPort& port, LinkClient* client, const UsbCounters& counters) = 0;
  // After each round of events, outside of any completion.
  virtual void served() noexcept = 0;

 protected:
  ~UsbClients() = default;
};

class UsbHost {
 public:
  // Starts to listen for devices. kSystem if this system's libusb has no hotplug, or with libusb's reason.
  // REQUIRES: clients outlives the host.
  [[nodiscard]] static Expected<std::unique_ptr<UsbHost>> create(UsbOptions options, UsbClients& clients);
  UsbHost(const UsbHost&) = delete;
  UsbHost& operator=(const UsbHost&) = delete;
  // REQUIRES: run() is not running.
  ~UsbHost();

  // Serves until stop(). Before it returns, every line is closed.
  void run();
  // From any thread, also before run().
  void stop();

 private:
  class Impl;
  explicit UsbHost(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace submapd::driver
