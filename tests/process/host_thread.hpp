// A USB host on a thread of its own, and waiting for what its clients note: what the rigs of process tests share.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "driver/usb/usb_host.hpp"

namespace submapd::driver::test {

class HostThread {
 public:
  HostThread() = default;
  HostThread(const HostThread&) = delete;
  HostThread& operator=(const HostThread&) = delete;

  void stop() {
    if (thread_.joinable()) {
      host_->stop();
      thread_.join();
      host_.reset();
    }
  }
  // True as soon as the condition holds, which is looked at with the mutex held whenever `changed` is notified; false
  // if it does not within the time.
  bool wait(const std::function<bool()>& condition, int seconds = 15) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, std::chrono::seconds(seconds), condition);
  }

  std::mutex mutex;
  std::condition_variable changed;

 protected:
  // REQUIRES: the derived rig's destructor calls stop() while the clients are still there.
  ~HostThread() = default;
  void start_host(UsbOptions options, UsbClients& clients) {
    auto host = UsbHost::create(std::move(options), clients);
    ASSERT_TRUE(host.has_value()) << host.error().message;
    host_ = std::move(*host);
    thread_ = std::thread([this] { host_->run(); });
  }

 private:
  std::unique_ptr<UsbHost> host_;
  std::thread thread_;
};

}  // namespace submapd::driver::test
