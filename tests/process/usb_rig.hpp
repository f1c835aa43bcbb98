// The driver's USB host on a thread of its own, facing emulated scanners behind the real libusb.
#pragma once

#include <gtest/gtest.h>

#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "driver/monotonic.hpp"
#include "driver/usb/usb_host.hpp"
#include "tests/process/host_thread.hpp"
#include "tests/unit/driver_sim/sim_rig.hpp"
#include "tools/hokuyo_sim/umockdev_front.hpp"

namespace submapd::driver::test {

// What one client saw, guarded by the rig's mutex.
struct LineRecord {
  std::string bytes;
  std::vector<std::pair<std::uint64_t, std::int64_t>> stamps;  // offset of a transfer's first byte, its stamp
  std::vector<LinkFault> faults;
  int opens = 0;
  int closes = 0;
  UsbPort port;
};

// Asks for a stream as soon as the line opens and writes down what comes.
class RecordingClient final : public LinkClient {
 public:
  RecordingClient(std::mutex& mutex, std::condition_variable& changed, LineRecord& record)
      : mutex_(mutex), changed_(changed), record_(record) {}

  void on_open(ByteLink& link, std::int64_t) noexcept override {
    link_ = &link;
    note([this] { ++record_.opens; });
    ask("QT\nMD0000108001000\n");
  }
  void on_close(std::int64_t) noexcept override {
    link_ = nullptr;
    note([this] { ++record_.closes; });
  }
  void on_stop(std::int64_t) noexcept override { ask("QT\n"); }
  void on_bytes(std::span<const std::uint8_t> bytes, std::int64_t stamp_ns, std::uint64_t offset) noexcept override {
    note([&] {
      record_.bytes.append(bytes.begin(), bytes.end());
      record_.stamps.emplace_back(offset, stamp_ns);
    });
  }
  void on_fault(LinkFault fault, std::int64_t) noexcept override {
    note([&] { record_.faults.push_back(fault); });
  }
  void on_time(std::int64_t) noexcept override {
    next_ns_ = kNever_ns;
    if (reset_ && link_ != nullptr) {
      reset_ = false;
      link_->reset();
    }
  }
  std::int64_t next_time_ns() const noexcept override { return next_ns_; }
  // REQUIRES: set before the line opens.
  void reset_at(std::int64_t when_ns) {
    reset_ = true;
    next_ns_ = when_ns;
  }

 private:
  void ask(std::string_view text) noexcept {
    EXPECT_TRUE(link_->write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
  }
  template <typename F>
  void note(F&& change) {
    {
      const std::lock_guard lock(mutex_);
      change();
    }
    changed_.notify_all();
  }

  std::mutex& mutex_;
  std::condition_variable& changed_;
  LineRecord& record_;
  ByteLink* link_ = nullptr;
  bool reset_ = false;
  std::int64_t next_ns_ = kNever_ns;
};

class UsbRig : public HostThread, public UsbClients {
 public:
  explicit UsbRig(UsbOptions options = {}) : options_(std::move(options)) {}
  ~UsbRig() { stop(); }

  // Plugs a scanner in that boots at once.
  std::size_t plug(const std::string& port, SimSensorOptions sensor = {}, tools::CdcLayout layout = {}) {
    sensor.boot_ns = 0;
    tools::EmulatedScanner scanner;
    scanner.port = port;
    scanner.layout = layout;
    scanner.sensor = std::move(sensor);
    scanner.ranges = turning_ranges;
    scanner.truth = [this, port](const SimScanTruth& scan) {
      const std::lock_guard lock(mutex);
      truth[port].push_back(scan);
    };
    return front.plug(std::move(scanner));
  }

  void start() { start_host(options_, *this); }

  LinkClient* arrived(const UsbPort& port) override {
    const std::lock_guard lock(mutex);
    records.push_back(std::make_unique<LineRecord>());
    records.back()->port = port;
    clients_.push_back(std::make_unique<RecordingClient>(mutex, changed, *records.back()));
    if (reset_after_ns > 0) {
      clients_.back()->reset_at(monotonic_now_ns() + reset_after_ns);
      reset_after_ns = 0;
    }
    return clients_.back().get();
  }
  void cannot_open(const UsbPort& /*port*/, const Error& error) override {
    {
      const std::lock_guard lock(mutex);
      errors.push_back(error.message);
    }
    changed.notify_all();
  }
  void gone(const UsbPort& /*port*/, LinkClient* /*client*/, const UsbCounters& seen) override {
    {
      const std::lock_guard lock(mutex);
      counters.push_back(seen);
    }
    changed.notify_all();
  }

  std::vector<std::unique_ptr<LineRecord>> records;  // in order of arrival
  std::vector<std::string> errors;
  std::vector<UsbCounters> counters;  // of lines that are gone
  std::map<std::string, std::vector<SimScanTruth>> truth;
  std::int64_t reset_after_ns = 0;
  void served() noexcept override {}

  tools::UmockdevFront front;  // after what its scanners write to

 private:
  UsbOptions options_;
  std::vector<std::unique_ptr<RecordingClient>> clients_;
};

}  // namespace submapd::driver::test
