#include "tools/hokuyo_sim/umockdev_front.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <string_view>
#include <thread>

#include "driver/monotonic.hpp"
#include "tools/hokuyo_sim/mock_node.hpp"

namespace submapd::tools {

using driver::SimOutput;
using driver::SimSensor;

struct UmockdevFront::Testbed {
  UMockdevTestbed* bed = umockdev_testbed_new();
  std::mutex mutex;  // of the calls that change the testbed
  std::atomic<int> next_address{2};
  ~Testbed() { g_object_unref(bed); }
};

// One scanner: its sensor, the node of the present plugging, and the thread that moves bytes when they are due.
class UmockdevFront::Scanner {
 public:
  Scanner(Testbed& testbed, EmulatedScanner scanner)
      : testbed_(testbed),
        port_(std::move(scanner.port)),
        layout_(scanner.layout),
        sensor_(std::move(scanner.sensor), scanner.ranges(), std::move(scanner.truth)) {
    sensor_.power_on(driver::monotonic_now_ns());
    plug();
    pump_ = std::thread([this] { pump(); });
  }
  Scanner(const Scanner&) = delete;
  Scanner& operator=(const Scanner&) = delete;
  ~Scanner() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    pump_.join();
    unplug();
  }

  void plug();
  void unplug();
  void with_sensor(const std::function<void(SimSensor&)>& fn) {
    {
      const std::lock_guard lock(mutex_);
      fn(sensor_);
    }
    changed_.notify_all();
  }

 private:
  void pump();
  void bus_event(SimOutput::Kind kind);

  Testbed& testbed_;
  std::string port_;
  CdcLayout layout_;
  std::mutex mutex_;
  std::condition_variable changed_;
  SimSensor sensor_;                              // guarded by mutex_
  std::vector<std::unique_ptr<MockNode>> nodes_;  // the last is the present one; a client may still hold older ones
  std::string syspath_;                           // empty: unplugged
  bool stop_ = false;
  std::thread pump_;
};

void UmockdevFront::Scanner::plug() {
  const int address = testbed_.next_address++;
  const int bus = port_.front() - '0';
  const std::string node_name = fmt::format("/dev/bus/usb/{:03d}/{:03d}", bus, address);
  auto node = std::make_unique<MockNode>(layout_, sensor_, mutex_, changed_);
  const std::lock_guard bed_lock(testbed_.mutex);
  node->attach(testbed_.bed, node_name);
  std::string hex;
  for (const std::uint8_t byte : descriptors(layout_)) {
    hex += fmt::format("{:02x}", byte);
  }
  const int minor = (bus - 1) * 128 + address - 1;
  const std::string path = fmt::format("/devices/pci0000:00/usb{}/{}", bus, port_);
  const std::string text = fmt::format(
      "P: {0}\nE: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: DEVNAME={1}\nE: BUSNUM={2:03d}\nE: DEVNUM={3:03d}\n"
      "E: MAJOR=189\nE: MINOR={4}\nA: busnum={2}\\n\nA: devnum={3}\\n\nA: bConfigurationValue=1\\n\nA: speed=12\\n\n"
      "A: idVendor={5:04x}\\n\nA: idProduct={6:04x}\\n\nA: dev=189:{4}\\n\nH: descriptors={7}\n",
      path, node_name, bus, address, minor, layout_.vendor_id, layout_.product_id, hex);
  {
    const std::lock_guard lock(mutex_);
    nodes_.push_back(std::move(node));
    syspath_ = "/sys" + path;
  }
  GError* error = nullptr;
  if (umockdev_testbed_add_from_string(testbed_.bed, text.c_str(), &error) == 0) {
    throw std::runtime_error(std::string("umockdev: ") + error->message);
  }
}

void UmockdevFront::Scanner::unplug() {
  const std::lock_guard bed_lock(testbed_.mutex);
  std::string syspath;
  {
    const std::lock_guard lock(mutex_);
    syspath.swap(syspath_);
    if (syspath.empty()) {
      return;
    }
    nodes_.back()->vanish();
  }
  umockdev_testbed_uevent(testbed_.bed, syspath.c_str(), "remove");
  umockdev_testbed_remove_device(testbed_.bed, syspath.c_str());
}

void UmockdevFront::Scanner::bus_event(SimOutput::Kind kind) {
  if (kind == SimOutput::Kind::kUnplug) {
    unplug();
  } else {
    plug();
  }
}

void UmockdevFront::Scanner::pump() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    while (auto output = sensor_.take(driver::monotonic_now_ns())) {
      if (output->kind == SimOutput::Kind::kUnplug || output->kind == SimOutput::Kind::kReplug) {
        lock.unlock();
        bus_event(output->kind);
        lock.lock();
      } else {
        nodes_.back()->put(std::move(*output));
      }
    }
    const std::int64_t wait_ns = sensor_.next_event_ns() - driver::monotonic_now_ns();
    if (wait_ns > 0 && !stop_) {
      changed_.wait_for(lock, std::chrono::nanoseconds(wait_ns));
    }
  }
}

UmockdevFront::UmockdevFront() : testbed_(std::make_unique<Testbed>()) {}
UmockdevFront::~UmockdevFront() {
  scanners_.clear();
}

// umockdev_in_mock_environment() tells only of a testbed that is there already.
bool UmockdevFront::available() {
  const char* const preloaded = std::getenv("LD_PRELOAD");
  return preloaded != nullptr && std::string_view(preloaded).find("umockdev-preload") != std::string_view::npos;
}

std::string UmockdevFront::root() const {
  gchar* const dir = umockdev_testbed_get_root_dir(testbed_->bed);
  std::string out(dir);
  g_free(dir);
  return out;
}

std::size_t UmockdevFront::plug(EmulatedScanner scanner) {
  scanners_.push_back(std::make_unique<Scanner>(*testbed_, std::move(scanner)));
  return scanners_.size() - 1;
}

void UmockdevFront::unplug(std::size_t index) {
  scanners_[index]->unplug();
}
void UmockdevFront::replug(std::size_t index) {
  scanners_[index]->plug();
}
void UmockdevFront::with_sensor(std::size_t index, const std::function<void(SimSensor&)>& fn) {
  scanners_[index]->with_sensor(fn);
}

}  // namespace submapd::tools
