#include "driver/usb/reset_worker.hpp"

namespace submapd::driver {

ResetWorker::ResetWorker(libusb_context* context) : context_(context), thread_([this] { run(); }) {}

ResetWorker::~ResetWorker() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

bool ResetWorker::start(libusb_device_handle* handle) {
  {
    const std::lock_guard lock(mutex_);
    if (handle_ != nullptr) {
      return false;
    }
    handle_ = handle;
    finished_ = false;
  }
  changed_.notify_all();
  return true;
}

bool ResetWorker::finished(const libusb_device_handle* handle) {
  const std::lock_guard lock(mutex_);
  if (handle_ != handle || !finished_) {
    return false;
  }
  handle_ = nullptr;
  return true;
}

void ResetWorker::run() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    if (handle_ == nullptr || finished_) {
      changed_.wait(lock);
      continue;
    }
    libusb_device_handle* const handle = handle_;
    lock.unlock();
    // A device that comes back differently is announced by hotplug, so the result tells nothing more.
    static_cast<void>(libusb_reset_device(handle));
    lock.lock();
    finished_ = true;
    libusb_interrupt_event_handler(context_);
  }
}

}  // namespace submapd::driver
