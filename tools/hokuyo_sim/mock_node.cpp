#include "tools/hokuyo_sim/mock_node.hpp"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

// After sys/ioctl.h, whose _IO macros it uses.
#include <linux/usbdevice_fs.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <utility>
#include <vector>

#include "driver/monotonic.hpp"

namespace submapd::tools {
namespace {

constexpr int kPipeBytes = 4096;

// Hands a node over to umockdev's threads in a way that ThreadSanitizer sees, which GLib's locks are not.
std::atomic<unsigned> handed_over{0};

usbdevfs_urb& urb_of(UMockdevIoctlData* data) {
  return *reinterpret_cast<usbdevfs_urb*>(data->data);
}

UMockdevIoctlData* resolve(UMockdevIoctlData* data, std::size_t offset, std::size_t size) {
  return umockdev_ioctl_data_resolve(data, offset, size, nullptr);
}

template <typename T>
void write_value(UMockdevIoctlData* arg, const T& value) {
  UMockdevIoctlData* const target = resolve(arg, 0, sizeof(T));
  if (target != nullptr) {
    umockdev_ioctl_data_update(target, 0, reinterpret_cast<guint8*>(const_cast<T*>(&value)), sizeof(T));
    umockdev_ioctl_data_unref(target);
  }
}

}  // namespace

MockNode::MockNode(const CdcLayout& layout, driver::SimSensor& sensor, std::mutex& mutex,
                   std::condition_variable& changed)
    : layout_(layout), sensor_(sensor), mutex_(mutex), changed_(changed), in_(layout.zero_length_packets) {}

MockNode::~MockNode() {
  forget_all();
  if (handler_ != nullptr) {
    g_object_unref(handler_);
  }
  if (fifo_ >= 0) {
    close(fifo_);
  }
}

void MockNode::attach(UMockdevTestbed* bed, const std::string& node_name) {
  handed_over.fetch_add(1, std::memory_order_release);
  handler_ = umockdev_ioctl_base_new();
  g_signal_connect(handler_, "handle-ioctl", G_CALLBACK(&MockNode::on_ioctl), this);
  GError* error = nullptr;
  if (umockdev_testbed_attach_ioctl(bed, node_name.c_str(), handler_, &error) == 0) {
    throw std::runtime_error(std::string("umockdev: ") + error->message);
  }
  gchar* const root = umockdev_testbed_get_root_dir(bed);
  const std::filesystem::path path = std::string(root) + node_name;
  g_free(root);
  std::filesystem::create_directories(path.parent_path());
  if (mkfifo(path.c_str(), 0600) != 0 || (fifo_ = open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC)) < 0 ||
      fcntl(fifo_, F_SETPIPE_SZ, kPipeBytes) < 0) {
    throw std::runtime_error("cannot make the device node " + path.string() + ": " + std::strerror(errno));
  }
  show_reapable();
}

// The pipe is full while nothing can be reaped: the kernel's node signals "reapable" as writable.
void MockNode::show_reapable() {
  const bool nothing = done_.empty() && !gone_;
  if (nothing == fifo_full_) {
    return;
  }
  std::vector<char> bytes(kPipeBytes, 'x');
  const ssize_t moved = nothing ? write(fifo_, bytes.data(), bytes.size()) : read(fifo_, bytes.data(), bytes.size());
  fifo_full_ = nothing && moved > 0;
}

void MockNode::finish(Urb urb, int status) {
  urb.status = status;
  done_.push_back(urb);
}

// Of whoever had the node open before: a program that was killed leaves its transfers, and umockdev tells nobody.
void MockNode::forget_all() {
  for (std::deque<Urb>* const urbs : {&reading_, &waiting_, &done_}) {
    for (Urb& urb : *urbs) {
      g_clear_object(&urb.data);
      g_clear_object(&urb.buffer);
    }
    urbs->clear();
  }
  if (fifo_ >= 0) show_reapable();
}

void MockNode::end_all(int status) {
  for (std::deque<Urb>* const urbs : {&reading_, &waiting_}) {
    for (; !urbs->empty(); urbs->pop_front()) {
      finish(urbs->front(), status);
    }
  }
}

void MockNode::service() {
  while (!gone_ && !halted_ && !reading_.empty()) {
    Urb& urb = reading_.front();
    const auto size = static_cast<std::size_t>(urb.buffer->data_len);
    if (!in_.fill({urb.buffer->data, size}, urb.filled)) {
      break;
    }
    finish(urb, 0);
    reading_.pop_front();
  }
  if (halted_) {
    for (; !reading_.empty(); reading_.pop_front()) {
      finish(reading_.front(), -EPIPE);
    }
  }
  show_reapable();
}

void MockNode::put(driver::SimOutput output) {
  switch (output.kind) {
    case driver::SimOutput::Kind::kBytes:
      in_.push(std::move(output.bytes), output.message_end);
      break;
    case driver::SimOutput::Kind::kStall:
      halted_ = true;
      break;
    case driver::SimOutput::Kind::kOverflow:
      if (!reading_.empty()) {
        finish(reading_.front(), -EOVERFLOW);
        reading_.pop_front();
      }
      break;
    default:
      break;
  }
  service();
}

void MockNode::vanish() {
  gone_ = true;
  end_all(-ESHUTDOWN);
  show_reapable();
}

gboolean MockNode::on_ioctl(UMockdevIoctlBase* /*base*/, UMockdevIoctlClient* client, gpointer self) {
  static_cast<void>(handed_over.load(std::memory_order_acquire));
  static_cast<MockNode*>(self)->handle(client);
  return TRUE;
}

void MockNode::handle(UMockdevIoctlClient* client) {
  UMockdevIoctlData* const arg = umockdev_ioctl_client_get_arg(client);
  const gulong request = umockdev_ioctl_client_get_request(client);
  std::uint64_t value = 0;
  std::memcpy(&value, arg->data, std::min(sizeof(value), static_cast<std::size_t>(arg->data_len)));
  int error = 0;
  // Also while umockdev completes the call: it reads the buffers that the pump fills.
  const std::lock_guard lock(mutex_);
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:  // the first that libusb asks of a node it opened
      forget_all();
      write_value<std::uint32_t>(arg, USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                          USBDEVFS_CAP_REAP_AFTER_DISCONNECT | USBDEVFS_CAP_BULK_CONTINUATION);
      break;
    case USBDEVFS_SUBMITURB:
      error = gone_ ? ENODEV : submit(arg);
      break;
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY:
      error = reap(arg);
      break;
    case USBDEVFS_DISCARDURB:
      error = gone_ ? ENODEV : discard(value);
      break;
    case USBDEVFS_GETDRIVER: {
      usbdevfs_getdriver driver{};
      std::strcpy(driver.driver, "cdc_acm");
      write_value(arg, driver);
      break;
    }
    case USBDEVFS_CLEAR_HALT:
      halted_ = false;
      service();
      break;
    case USBDEVFS_RESET:
      halted_ = false;
      in_.clear();
      end_all(-ENOENT);
      sensor_.usb_reset(driver::monotonic_now_ns());
      show_reapable();
      break;
    case USBDEVFS_CLAIMINTERFACE:
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_DISCONNECT_CLAIM:
    case USBDEVFS_IOCTL:  // disconnect and connect of the kernel's driver
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_SETINTERFACE:
      error = gone_ ? ENODEV : 0;
      break;
    default:
      error = ENOTTY;
      break;
  }
  changed_.notify_all();
  umockdev_ioctl_client_complete(client, error == 0 ? 0 : -1, error);
}

int MockNode::submit(UMockdevIoctlData* arg) {
  Urb urb;
  urb.data = resolve(arg, 0, sizeof(usbdevfs_urb));
  if (urb.data == nullptr) {
    return EFAULT;
  }
  const usbdevfs_urb& request = urb_of(urb.data);
  urb.buffer = resolve(urb.data, offsetof(usbdevfs_urb, buffer), static_cast<std::size_t>(request.buffer_length));
  if (urb.buffer == nullptr) {
    g_clear_object(&urb.data);
    return EFAULT;
  }
  if (request.type == USBDEVFS_URB_TYPE_CONTROL) {
    control(urb);
  } else if (request.endpoint == layout_.bulk_in) {
    reading_.push_back(urb);
  } else if (request.endpoint == layout_.interrupt_in) {
    waiting_.push_back(urb);
  } else if (request.endpoint == layout_.bulk_out) {
    const auto length = static_cast<std::size_t>(request.buffer_length);
    sensor_.receive(driver::monotonic_now_ns(), {urb.buffer->data, length});
    urb.filled = length;
    finish(urb, 0);
  } else {
    finish(urb, -EPIPE);
  }
  service();
  return 0;
}

void MockNode::control(Urb& urb) {
  constexpr std::size_t kSetup = 8;
  const auto size = static_cast<std::size_t>(urb.buffer->data_len);
  const auto answer = answer_control(layout_, {urb.buffer->data, size});
  if (!answer) {
    finish(urb, -EPIPE);
    return;
  }
  const bool to_host = (urb.buffer->data[0] & 0x80U) != 0;
  urb.filled = to_host ? std::min(answer->size(), size - kSetup) : size - kSetup;
  if (to_host && urb.filled > 0) {
    std::memcpy(urb.buffer->data + kSetup, answer->data(), urb.filled);
  }
  finish(urb, 0);
}

int MockNode::reap(UMockdevIoctlData* arg) {
  if (done_.empty()) {
    return gone_ ? ENODEV : EAGAIN;
  }
  Urb urb = done_.front();
  done_.pop_front();
  usbdevfs_urb& result = urb_of(urb.data);
  result.status = urb.status;
  result.actual_length = static_cast<int>(urb.filled);
  UMockdevIoctlData* const target = resolve(arg, 0, sizeof(gpointer));
  if (target != nullptr) {
    umockdev_ioctl_data_set_ptr(target, 0, urb.data);
    umockdev_ioctl_data_unref(target);
  }
  g_object_unref(urb.data);
  g_object_unref(urb.buffer);
  show_reapable();
  return 0;
}

int MockNode::discard(std::uint64_t address) {
  for (std::deque<Urb>* const urbs : {&reading_, &waiting_}) {
    const auto found = std::find_if(urbs->begin(), urbs->end(),
                                    [address](const Urb& urb) { return urb.data->client_addr == address; });
    if (found != urbs->end()) {
      finish(*found, -ENOENT);
      urbs->erase(found);
      show_reapable();
      return 0;
    }
  }
  return EINVAL;
}

}  // namespace submapd::tools
