// One plugging of an emulated scanner: a device node, its URBs, and the answers to usbfs ioctls.
//
// Internal to the umockdev front. Everything but attach() happens with the scanner's mutex held: the ioctl handler
// takes it itself, put() and vanish() want it held.
#pragma once

#include <umockdev-1.0/umockdev.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>

#include "driver/sim/sim_sensor.hpp"
#include "tools/hokuyo_sim/cdc_function.hpp"

namespace submapd::tools {

class MockNode {
 public:
  // All references must outlive the node. `changed` is notified when the sensor was written to.
  MockNode(const CdcLayout& layout, driver::SimSensor& sensor, std::mutex& mutex, std::condition_variable& changed);
  MockNode(const MockNode&) = delete;
  MockNode& operator=(const MockNode&) = delete;
  ~MockNode();

  // Makes the node in the testbed. REQUIRES: called once. Throws std::runtime_error if it cannot.
  void attach(UMockdevTestbed* bed, const std::string& node_name);
  // Bytes, a stall or an overflow from the sensor.
  void put(driver::SimOutput output);
  // The cable is pulled: all URBs end, every later ioctl gets ENODEV.
  void vanish();

 private:
  struct Urb {
    UMockdevIoctlData* data = nullptr;    // struct usbdevfs_urb; owns a reference
    UMockdevIoctlData* buffer = nullptr;  // owns a reference
    std::size_t filled = 0;
    int status = 0;
  };

  static gboolean on_ioctl(UMockdevIoctlBase* base, UMockdevIoctlClient* client, gpointer self);
  void handle(UMockdevIoctlClient* client);
  [[nodiscard]] int submit(UMockdevIoctlData* arg);
  [[nodiscard]] int reap(UMockdevIoctlData* arg);
  [[nodiscard]] int discard(std::uint64_t address);
  void control(Urb& urb);
  void service();
  void finish(Urb urb, int status);
  void forget_all();
  void end_all(int status);
  void show_reapable();

  CdcLayout layout_;
  driver::SimSensor& sensor_;
  std::mutex& mutex_;
  std::condition_variable& changed_;
  UMockdevIoctlBase* handler_ = nullptr;
  int fifo_ = -1;
  bool fifo_full_ = false;  // nothing to reap: the client's poll() sleeps
  bool gone_ = false;
  bool halted_ = false;
  BulkInQueue in_;
  std::deque<Urb> reading_;  // bulk IN, in order
  std::deque<Urb> waiting_;  // interrupt IN: never answered
  std::deque<Urb> done_;
};

}  // namespace submapd::tools
