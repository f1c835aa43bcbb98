#include "daemon/lcm_input.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <lcm/lcm-cpp.hpp>

#include "daemon/lcm_receive.hpp"
#include "daemon/multicast_route.hpp"
#include "daemon/realtime.hpp"
#include "daemon/scan_stamper.hpp"

namespace submapd {
namespace {

constexpr int kPatience_ms = 100;
constexpr int kQueue = 400;  // scans that LCM keeps while the thread sleeps
constexpr std::chrono::milliseconds kTryAgain{500};

}  // namespace

LcmInput::LcmInput(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell)
    : ScanInput(configuration, mapper_bell, recorder_bell),
      url_(configuration.lcm.url),
      channels_(configuration.lcm.prefix) {}

LcmInput::~LcmInput() {
  stop();
}

ScanGeometry LcmInput::geometry() const {
  return utm30lx_geometry();
}

Status LcmInput::start() {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  return {};
}

void LcmInput::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
}

std::string LcmInput::trouble() const {
  if (!network_.load()) return "no network for LCM at " + url_ + ", where the scans should come from";
  const std::uint64_t refused = refused_.load();
  return refused > 0 ? fmt::format("{} scans over LCM were not taken: damaged, of another run or scanner", refused)
                     : "";
}

void LcmInput::run(const std::stop_token& stop) {
  name_thread("input");
  while (!stop.stop_requested()) {
    heartbeat_.beat();
    if (has_multicast_route(url_)) {
      lcm::LCM lcm(url_);
      if (can_receive(lcm)) {
        network_.store(true);
        listen(lcm, stop);
        network_.store(false);
      }
    }
    if (!stop.stop_requested()) std::this_thread::sleep_for(kTryAgain);
  }
}

void LcmInput::listen(lcm::LCM& lcm, const std::stop_token& stop) {
  for (const std::string* const channel : {&channels_.scan_h, &channels_.scan_v}) {
    lcm.subscribeFunction(*channel, &LcmInput::on_scan, this)->setQueueCapacity(kQueue);
  }
  while (!stop.stop_requested()) {
    heartbeat_.beat();
    if (lcm.handleTimeout(kPatience_ms) < 0) return;
  }
}

void LcmInput::on_scan(const lcm::ReceiveBuffer* buffer, const std::string& channel, LcmInput* self) {
  const Expected<ScanMessage> message = decode_scan(bytes_of(buffer));
  if (!message) {
    self->refused_.fetch_add(1);
    return;
  }
  self->take(channel == self->channels_.scan_h ? driver::SensorRole::kHorizontal : driver::SensorRole::kVertical,
             *message);
}

void LcmInput::take(driver::SensorRole role, const ScanMessage& message) {
  if (!run_) run_ = message.origin.run;
  if (message.origin.run != *run_ || !fits(message.scan)) {
    refused_.fetch_add(1);
    return;
  }
  if (message.scan.stamp_us <= skip_until_us_[static_cast<std::size_t>(role)]) return;
  now_ns_->store(std::max(message.scan.stamp_us * 1000, now_ns_->load()));
  push(role, message);
}

}  // namespace submapd
