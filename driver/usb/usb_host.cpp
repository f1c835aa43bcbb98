#include "driver/usb/usb_host.hpp"

#include <libusb.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <ctime>
#include <string>
#include <utility>

#include "driver/monotonic.hpp"
#include "driver/usb/reset_worker.hpp"
#include "driver/usb/usb_line.hpp"

namespace submapd::driver {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kFirstPatience_ns = kSecond_ns / 4;
constexpr std::int64_t kMostPatience_ns = 10 * kSecond_ns;

std::string path_of(libusb_device* device) {
  constexpr int kDeepest = 7;  // of USB's tree
  std::array<std::uint8_t, kDeepest> ports{};
  const int depth = libusb_get_port_numbers(device, ports.data(), kDeepest);
  std::string path = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < depth; ++i) {
    path += i == 0 ? '-' : '.';
    path += std::to_string(ports[static_cast<std::size_t>(i)]);
  }
  return path;
}

}  // namespace

class UsbHost::Impl {
 public:
  Impl(UsbOptions options, UsbClients& clients) : options_(std::move(options)), clients_(clients) {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl();

  [[nodiscard]] Expected<void> start();
  void run();
  void stop() {
    stop_ = true;
    libusb_interrupt_event_handler(context_);
  }

 private:
  struct Port {
    libusb_device* device = nullptr;  // owns a reference
    UsbPort info;
    UsbCounters counters;
    LinkClient* client = nullptr;
    std::unique_ptr<UsbLine> line;
    bool here = true;
    bool resetting = false;
    std::int64_t next_try_ns = 0;
    std::int64_t patience_ns = kFirstPatience_ns;
    std::string told;  // the last reason why it cannot be opened
  };

  static int LIBUSB_CALL on_hotplug(libusb_context* context, libusb_device* device, libusb_hotplug_event event,
                                    void* self);
  static void LIBUSB_CALL on_pollfd_added(int fd, short events, void* self);
  static void LIBUSB_CALL on_pollfd_removed(int fd, void* self);
  void arrive(libusb_device* device);
  void serve_arrivals();
  void serve(Port& port, std::int64_t now_ns);
  void serve_line(Port& port, std::int64_t now_ns);
  void open(Port& port, std::int64_t now_ns);
  [[nodiscard]] std::int64_t next_time_ns() const;
  void wait_for_events();

  UsbOptions options_;
  UsbClients& clients_;
  libusb_context* context_ = nullptr;
  libusb_hotplug_callback_handle hotplug_ = 0;
  std::unique_ptr<ResetWorker> resets_;
  // Filled by the hotplug callback, in which a device may not be spoken with.
  std::vector<std::pair<libusb_device*, bool>> hotplug_events_;  // device with a reference, arrived
  std::vector<std::unique_ptr<Port>> ports_;
  std::vector<pollfd> polled_;  // what libusb waits for, its own timer included
  std::atomic<bool> stop_{false};
};

UsbHost::Impl::~Impl() {
  resets_.reset();
  for (const auto& port : ports_) {
    libusb_unref_device(port->device);
  }
  for (const auto& [device, arrived] : hotplug_events_) {
    libusb_unref_device(device);
  }
  if (context_ != nullptr) {
    libusb_hotplug_deregister_callback(context_, hotplug_);
    libusb_exit(context_);
  }
}

Expected<void> UsbHost::Impl::start() {
  if (const int code = libusb_init(&context_); code != 0) {
    return failure(ErrorCode::kSystem,
                   std::string("cannot start libusb: ") + libusb_strerror(static_cast<libusb_error>(code)));
  }
  if (libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) == 0) {
    return failure(ErrorCode::kSystem, "this libusb cannot tell of devices that come and go (hotplug)");
  }
  libusb_set_pollfd_notifiers(context_, &Impl::on_pollfd_added, &Impl::on_pollfd_removed, this);
  const libusb_pollfd** const polled = libusb_get_pollfds(context_);
  for (std::size_t i = 0; polled != nullptr && polled[i] != nullptr; ++i) {
    on_pollfd_added(polled[i]->fd, polled[i]->events, this);
  }
  libusb_free_pollfds(polled);
  if (polled_.empty() || libusb_pollfds_handle_timeouts(context_) == 0) {
    return failure(ErrorCode::kSystem, "this libusb does not tell what it waits for, or has no timer of its own");
  }
  resets_ = std::make_unique<ResetWorker>(context_);
  const int code = libusb_hotplug_register_callback(
      context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, LIBUSB_HOTPLUG_ENUMERATE,
      LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, &Impl::on_hotplug, this, &hotplug_);
  if (code != 0) {
    return failure(ErrorCode::kSystem,
                   std::string("cannot listen for USB devices: ") + libusb_strerror(static_cast<libusb_error>(code)));
  }
  return {};
}

int UsbHost::Impl::on_hotplug(libusb_context* /*context*/, libusb_device* device, libusb_hotplug_event event,
                              void* self) {
  auto& host = *static_cast<Impl*>(self);
  host.hotplug_events_.emplace_back(libusb_ref_device(device), event == LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED);
  return 0;
}

void UsbHost::Impl::on_pollfd_added(int fd, short events, void* self) {
  static_cast<Impl*>(self)->polled_.push_back({fd, events, 0});
}

void UsbHost::Impl::on_pollfd_removed(int fd, void* self) {
  std::erase_if(static_cast<Impl*>(self)->polled_, [fd](const pollfd& polled) { return polled.fd == fd; });
}

void UsbHost::Impl::arrive(libusb_device* device) {
  libusb_device_descriptor descriptor{};
  if (libusb_get_device_descriptor(device, &descriptor) != 0) {
    return;
  }
  const UsbId id{descriptor.idVendor, descriptor.idProduct};
  const bool ours = std::any_of(options_.ids.begin(), options_.ids.end(), [&id](const UsbId& known) {
    return known.vendor_id == id.vendor_id && known.product_id == id.product_id;
  });
  if (!ours) {
    return;
  }
  auto port = std::make_unique<Port>();
  port->info = {path_of(device), libusb_get_device_address(device), id};
  if (ports_.size() >= options_.max_scanners) {
    clients_.cannot_open(port->info, {ErrorCode::kBusy, "more scanners than " + std::to_string(options_.max_scanners) +
                                                            " are plugged in; this one is left alone"});
    return;
  }
  port->client = clients_.arrived(port->info);
  if (port->client == nullptr) {
    return;
  }
  port->device = libusb_ref_device(device);
  ports_.push_back(std::move(port));
}

void UsbHost::Impl::serve_arrivals() {
  // Events may come while one is served: by index, and to the end of what is there then.
  for (std::size_t i = 0; i < hotplug_events_.size(); ++i) {
    const auto [device, arrived] = hotplug_events_[i];
    if (arrived) {
      arrive(device);
    } else {
      for (const auto& port : ports_) {
        port->here = port->here && port->device != device;
      }
    }
    libusb_unref_device(device);
  }
  hotplug_events_.clear();
}

void UsbHost::Impl::open(Port& port, std::int64_t now_ns) {
  auto line = UsbLine::open(port.device, options_, *port.client, port.counters);
  if (line) {
    port.line = std::move(*line);
    port.patience_ns = kFirstPatience_ns;
    port.told.clear();
    return;
  }
  port.next_try_ns = now_ns + port.patience_ns;
  port.patience_ns = std::min(2 * port.patience_ns, kMostPatience_ns);
  if (port.told != line.error().message) {
    port.told = line.error().message;
    clients_.cannot_open(port.info, line.error());
  }
}

void UsbHost::Impl::serve_line(Port& port, std::int64_t now_ns) {
  UsbLine& line = *port.line;
  if (!port.here || line.reset_wanted()) {
    line.close();
  } else if (stop_) {
    line.end(now_ns);
  }
  line.serve(now_ns);
  if (!line.done()) {
    if (!stop_ && port.client->next_time_ns() <= now_ns) {
      port.client->on_time(now_ns);
    }
    return;
  }
  if (port.resetting) {
    port.resetting = !resets_->finished(line.handle());
  } else if (line.reset_wanted() && port.here && !stop_) {
    port.resetting = resets_->start(line.handle());
    return;  // if another is being reset, once that one is through
  }
  if (!port.resetting) {
    port.line.reset();
    port.next_try_ns = now_ns + kFirstPatience_ns / 5;
  }
}

void UsbHost::Impl::serve(Port& port, std::int64_t now_ns) {
  if (port.line) {
    serve_line(port, now_ns);
  } else if (port.here && !stop_ && port.next_try_ns <= now_ns) {
    open(port, now_ns);
  }
}

std::int64_t UsbHost::Impl::next_time_ns() const {
  std::int64_t next_ns = LinkClient::kNever_ns;
  for (const auto& port : ports_) {
    const bool waits = !port->line;
    if (waits) {
      next_ns = std::min(next_ns, port->next_try_ns);
    } else if (!port->line->done() && !stop_) {
      next_ns = std::min(next_ns, port->client->next_time_ns());
    }
  }
  return next_ns;
}

// libusb's own waiting ends at whole milliseconds only: the clock's questions would keep step with them.
void UsbHost::Impl::wait_for_events() {
  constexpr std::int64_t kLongest_ns = 60 * kSecond_ns;
  const std::int64_t wait_ns = std::clamp<std::int64_t>(next_time_ns() - monotonic_now_ns(), 0, kLongest_ns);
  const timespec timeout{wait_ns / kSecond_ns, wait_ns % kSecond_ns};
  if (ppoll(polled_.data(), polled_.size(), &timeout, nullptr) > 0) {
    timeval no_more_waiting{};
    libusb_handle_events_timeout_completed(context_, &no_more_waiting, nullptr);
  }
}

void UsbHost::Impl::run() {
  for (;;) {
    serve_arrivals();
    const std::int64_t now_ns = monotonic_now_ns();
    for (const auto& port : ports_) {
      serve(*port, now_ns);
    }
    std::erase_if(ports_, [this](const std::unique_ptr<Port>& port) {
      if (port->line || (port->here && !stop_)) {
        return false;
      }
      clients_.gone(port->info, port->client, port->counters);
      libusb_unref_device(port->device);
      return true;
    });
    clients_.served();
    if (stop_ && ports_.empty()) {
      return;
    }
    wait_for_events();
  }
}

UsbHost::UsbHost(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
UsbHost::~UsbHost() = default;

Expected<std::unique_ptr<UsbHost>> UsbHost::create(UsbOptions options, UsbClients& clients) {
  auto impl = std::make_unique<Impl>(std::move(options), clients);
  if (auto started = impl->start(); !started) {
    return tl::unexpected(std::move(started.error()));
  }
  return std::unique_ptr<UsbHost>(new UsbHost(std::move(impl)));
}

void UsbHost::run() {
  impl_->run();
}
void UsbHost::stop() {
  impl_->stop();
}

}  // namespace submapd::driver
