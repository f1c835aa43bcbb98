#include "driver/scanners.hpp"

#include <algorithm>
#include <utility>

namespace submapd::driver {

class Scanners::Scanner final : public SensorOwner {
 public:
  Scanner(Scanners& all, const UsbPort& where)
      : port(where), sensor(all.options_.sensor, where.path, *this), all_(all) {}
  Scanner(const Scanner&) = delete;
  Scanner& operator=(const Scanner&) = delete;
  ~Scanner() = default;

  Expected<SensorAssignment> assign(const SensorIdentity& identity) override { return all_.assign(*this, identity); }
  void on_status(const SensorStatus& /*status*/) noexcept override {
    dirty = true;
    all_.changed_ = true;
  }

  const UsbPort port;
  Sensor sensor;
  std::optional<SensorRole> role;
  std::string serial;  // as soon as it is known
  bool dirty = true;
  // What readers see, guarded by the mutex.
  SensorStatus shown;
  std::optional<SensorRole> shown_role;

 private:
  Scanners& all_;
};

Scanners::Scanners(ScannersOptions options, std::array<SensorSink*, kSensorRoles> sinks)
    : options_(std::move(options)), sinks_(sinks) {}
Scanners::~Scanners() = default;

Expected<SensorAssignment> Scanners::assign(Scanner& scanner, const SensorIdentity& identity) {
  scanner.serial = identity.serial;
  std::vector<std::string> present;
  for (const auto& other : scanners_) {
    if (!other->serial.empty()) {
      present.push_back(other->serial);
    }
  }
  const Expected<SensorRole> role = find_role(options_.roles, identity, present);
  if (!role) {
    return tl::unexpected(role.error());
  }
  for (const auto& other : scanners_) {
    if (other->role == *role) {
      return failure(ErrorCode::kBusy,
                     std::string("the role ") + letter_of(*role) + " is taken by scanner " + other->serial +
                         " at port " + other->port.path +
                         "; unplug one of them, or settle it with: submapctl sensors --assign H=SERIAL "
                         "V=SERIAL");
    }
  }
  scanner.role = *role;
  return SensorAssignment{sinks_[static_cast<std::size_t>(*role)], options_.intensity, false};
}

LinkClient* Scanners::arrived(const UsbPort& port) {
  auto scanner = std::make_unique<Scanner>(*this, port);
  LinkClient* const client = &scanner->sensor;
  scanner->shown = scanner->sensor.status();
  changed_ = true;
  const std::lock_guard lock(mutex_);
  scanners_.push_back(std::move(scanner));
  return client;
}

void Scanners::cannot_open(const UsbPort& port, const Error& error) {
  const std::lock_guard lock(mutex_);
  for (const auto& scanner : scanners_) {
    if (scanner->port.path == port.path) {
      scanner->shown.state = SensorState::kClosed;
      scanner->shown.words = error.message;
    }
  }
}

void Scanners::gone(const UsbPort& /*port*/, LinkClient* client, const UsbCounters& /*counters*/) {
  const std::lock_guard lock(mutex_);
  std::erase_if(scanners_, [client](const auto& scanner) { return &scanner->sensor == client; });
}

void Scanners::served() noexcept {
  if (!changed_) {
    return;
  }
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock.owns_lock()) {
    return;  // a reader is at it: after the next round
  }
  for (const auto& scanner : scanners_) {
    if (std::exchange(scanner->dirty, false)) {
      scanner->shown = scanner->sensor.status();
      scanner->shown_role = scanner->role;
    }
  }
  changed_ = false;
}

std::vector<ScannerInfo> Scanners::snapshot() const {
  const std::lock_guard lock(mutex_);
  std::vector<ScannerInfo> all;
  for (const auto& scanner : scanners_) {
    all.push_back({scanner->port, scanner->shown, scanner->shown_role, scanner->sensor.counters()});
  }
  return all;
}

void Scanners::ask_for_time() {
  const std::lock_guard lock(mutex_);
  for (const auto& scanner : scanners_) {
    scanner->sensor.ask_for_time();
  }
}

}  // namespace submapd::driver
