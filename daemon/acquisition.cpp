#include "daemon/acquisition.hpp"

#include <algorithm>
#include <future>

#include "daemon/realtime.hpp"

namespace submapd {
namespace {

driver::ClockOptions clock_options(const Configuration& configuration) {
  driver::ClockOptions options;
  options.stamp_to_first_beam_us = configuration.scanner.stamp_to_first_beam_us;
  return options;
}

driver::ScannersOptions scanners_options(const Configuration& configuration) {
  driver::ScannersOptions options;
  options.roles = configuration.scanner.roles;
  options.intensity = configuration.scanner.intensity;
  return options;
}

}  // namespace

Acquisition::Acquisition(const Configuration& configuration, driver::Doorbell& mapper_bell,
                         driver::Doorbell& recorder_bell)
    : ScanInput(configuration, mapper_bell, recorder_bell),
      horizontal_(clock_options(configuration), {&mapper_ring_, &recorder_h_}),
      vertical_(clock_options(configuration), {&recorder_v_, nullptr}),
      scanners_(scanners_options(configuration), {&horizontal_, &vertical_}),
      clients_(scanners_) {}

Acquisition::~Acquisition() {
  stop();
}

Status Acquisition::start() {
  driver::Expected<std::unique_ptr<driver::UsbHost>> host = driver::UsbHost::create({}, clients_);
  if (!host) return {StatusCode::kUnavailable, host.error().message};
  host_ = std::move(*host);
  std::promise<void> ready;
  thread_ = std::thread([this, &ready] {
    name_thread("usb");
    priority_ = take_fifo_priority(kUsbPriority);
    ready.set_value();
    host_->run();
  });
  ready.get_future().wait();
  return {};
}

bool Acquisition::must_move() const {
  // An open line always has a deadline that wakes the thread within a second or so.
  const std::vector<driver::ScannerInfo> present = scanners();
  return std::any_of(present.begin(), present.end(), [](const driver::ScannerInfo& scanner) {
    return scanner.status.state == driver::SensorState::kStreaming;
  });
}

void Acquisition::stop() {
  if (!thread_.joinable()) return;
  host_->stop();
  thread_.join();
}

}  // namespace submapd
