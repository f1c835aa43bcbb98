// An emulated scanner that USB/IP clients may import, and the conversation with one such client. No I/O.
//
// One thread. Times are the true clock's. A pulled cable (unplug, power-cycle) ends the conversation; after that the
// client imports again. The kernel's vhci-hcd keeps a port's reset to itself, so that the hang that only a reset of the
// USB device helps against (hang:reset) lasts for ever here.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "driver/sim/sim_sensor.hpp"
#include "tools/hokuyo_sim/usbip_message.hpp"

namespace submapd::tools {

class UsbipExport {
 public:
  static constexpr std::size_t kMostUrbs = 256;  // under way

  // REQUIRES: sensor outlives this.
  UsbipExport(UsbipDeviceInfo info, driver::SimSensor& sensor);
  UsbipExport(UsbipExport&&) = default;

  [[nodiscard]] const UsbipDeviceInfo& info() const { return info_; }
  [[nodiscard]] bool plugged_in() const { return plugged_in_; }
  [[nodiscard]] bool imported() const { return out_ != nullptr; }

  // Answers go to `out` until release(). REQUIRES: plugged in and not imported.
  void import(std::vector<std::uint8_t>& out);
  void release();
  UsbipError submit(std::int64_t now_ns, const UsbipSubmit& submit);
  void unlink(const UsbipUnlink& unlink);
  // What is due: bytes for transfers that wait, faults of the bus.
  void serve(std::int64_t now_ns);
  [[nodiscard]] std::int64_t next_event_ns() const { return sensor_->next_event_ns(); }

 private:
  struct Urb {
    std::uint32_t seqnum = 0;
    std::vector<std::uint8_t> buffer;
    std::size_t filled = 0;
  };

  void put(driver::SimOutput output);
  void control(const UsbipSubmit& submit);
  void fill();
  void fail(std::deque<Urb>& urbs, int status);

  UsbipDeviceInfo info_;
  driver::SimSensor* sensor_;
  std::vector<std::uint8_t>* out_ = nullptr;
  bool plugged_in_ = true;
  bool halted_ = false;
  BulkInQueue in_;
  std::deque<Urb> reading_;  // bulk IN, in order
  std::deque<Urb> waiting_;  // interrupt IN: never answered
};

class UsbipSession final : private UsbipListener {
 public:
  // REQUIRES: the exports stay where they are and outlive the session.
  explicit UsbipSession(std::span<UsbipExport> exports) : exports_(exports) {}
  UsbipSession(const UsbipSession&) = delete;
  UsbipSession& operator=(const UsbipSession&) = delete;
  ~UsbipSession();

  // False: the conversation is over, by an error of the client or because its scanner is unplugged.
  bool receive(std::int64_t now_ns, std::span<const std::uint8_t> bytes);
  [[nodiscard]] bool over() const;
  [[nodiscard]] UsbipError error() const { return parser_.error(); }
  // Answers that wait to be sent; whoever sends takes them away.
  [[nodiscard]] std::vector<std::uint8_t>& output() { return output_; }

 private:
  UsbipError on_devlist() override;
  UsbipError on_import(std::string_view busid, bool& imported) override;
  UsbipError on_submit(const UsbipSubmit& submit) override;
  UsbipError on_unlink(const UsbipUnlink& unlink) override;

  std::span<UsbipExport> exports_;
  UsbipExport* device_ = nullptr;  // imported
  UsbipParser parser_;
  std::vector<std::uint8_t> output_;
  std::int64_t now_ns_ = 0;  // of the call that is being served
};

}  // namespace submapd::tools
