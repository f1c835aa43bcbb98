// Resets USB devices on a thread of its own: the kernel takes hundreds of milliseconds for it, in which the event
// thread must go on serving the other scanner.
//
// Threads: start(), finished() and the constructor on the event thread. One reset at a time.
#pragma once

#include <libusb.h>

#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

namespace submapd::driver {

class ResetWorker {
 public:
  explicit ResetWorker(libusb_context* context);
  ResetWorker(const ResetWorker&) = delete;
  ResetWorker& operator=(const ResetWorker&) = delete;
  ~ResetWorker();  // waits for a reset that is under way

  // False: busy with another device. REQUIRES: no transfer of handle is under way, and it stays open until finished().
  [[nodiscard]] bool start(libusb_device_handle* handle);
  // True once after the reset of that handle ended, well or not.
  [[nodiscard]] bool finished(const libusb_device_handle* handle);

 private:
  void run();

  libusb_context* context_;
  std::mutex mutex_;
  std::condition_variable changed_;
  libusb_device_handle* handle_ = nullptr;  // being reset, or finished
  bool finished_ = false;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace submapd::driver
