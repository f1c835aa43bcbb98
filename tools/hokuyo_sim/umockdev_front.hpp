// Emulated scanners behind the real libusb: an umockdev testbed whose devices are SimSensors.
//
// The client (libusb in this process or in a child) must run under umockdev-wrapper. Threads: umockdev's own answer the
// client's ioctls, one pump per scanner moves its bytes when they are due; a mutex per scanner guards its sensor and
// its URBs. The device node is a FIFO that can be written to exactly while an URB can be reaped, so that the client's
// poll() works as with the kernel's node. One libusb client process per testbed.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "driver/sim/sim_sensor.hpp"
#include "tools/hokuyo_sim/cdc_function.hpp"

namespace submapd::tools {

struct EmulatedScanner {
  std::string port = "1-1";  // bus and root port, as sysfs names it; hubs are not emulated
  CdcLayout layout;
  driver::SimSensorOptions sensor;
  // Called once, to make what the sensor measures.
  std::function<std::unique_ptr<driver::RangeSource>()> ranges;
  driver::SimSensor::TruthSink truth;  // called from the scanner's pump or an ioctl thread, one at a time
};

class UmockdevFront {
 public:
  UmockdevFront();
  UmockdevFront(const UmockdevFront&) = delete;
  UmockdevFront& operator=(const UmockdevFront&) = delete;
  // REQUIRES: no client has a device open.
  ~UmockdevFront();

  // True if this process runs under umockdev-wrapper; without it there is nothing that a client could see.
  [[nodiscard]] static bool available();

  // The folder that a client finds in UMOCKDEV_DIR. Children inherit it.
  [[nodiscard]] std::string root() const;

  // Powers the scanner on and plugs it in. Returns its index.
  std::size_t plug(EmulatedScanner scanner);
  // The cable, by hand: out, and in again with a new address.
  void unplug(std::size_t index);
  void replug(std::size_t index);
  // Runs fn on the sensor while its scanner is locked.
  void with_sensor(std::size_t index, const std::function<void(driver::SimSensor&)>& fn);

 private:
  class Scanner;
  struct Testbed;
  std::unique_ptr<Testbed> testbed_;
  std::vector<std::unique_ptr<Scanner>> scanners_;
};

}  // namespace submapd::tools
