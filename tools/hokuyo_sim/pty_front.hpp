// An emulated scanner at a pseudo-terminal, for other SCIP software that opens a serial port.
//
// One thread, the caller's: run() serves until stop(). Bus faults of the script mean nothing here but a pause.
#pragma once

#include <atomic>
#include <string>

#include "driver/sim/sim_sensor.hpp"
#include "slam/base/status.hpp"

namespace submapd::tools {

class PtyFront {
 public:
  // Opens a pseudo-terminal in raw mode. REQUIRES: sensor outlives the front.
  [[nodiscard]] static Expected<PtyFront> open(driver::SimSensor& sensor);
  PtyFront(PtyFront&& other) noexcept;
  PtyFront& operator=(PtyFront&&) = delete;
  ~PtyFront();

  // What to open, e.g. /dev/pts/3.
  [[nodiscard]] const std::string& path() const { return path_; }
  // Powers the sensor on and serves it until `stop` is true; looks at least every 100 ms.
  void run(const std::atomic<bool>& stop);

 private:
  PtyFront(driver::SimSensor& sensor, int master, int slave, std::string path);

  driver::SimSensor& sensor_;
  int master_;
  int slave_;  // held open, so that a program that leaves does not hang up the line
  std::string path_;
};

}  // namespace submapd::tools
