#include "daemon/lcm_input.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <lcm/lcm-cpp.hpp>

#include "daemon/lcm_receive.hpp"
#include "daemon/scan_stamper.hpp"

namespace submapd {
namespace {

constexpr int kQueue = 400;  // scans that LCM keeps while the thread sleeps

}  // namespace

LcmInput::LcmInput(const Configuration& configuration, driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell)
    : ScanInput(configuration, mapper_bell, recorder_bell),
      url_(configuration.lcm.url),
      channels_(configuration.lcm.prefix) {}

ScanGeometry LcmInput::geometry() const {
  return utm30lx_geometry();
}

Status LcmInput::start() {
  listener_ = std::make_unique<LcmListener>(
      url_, "input",
      [this](lcm::LCM& network) {
        for (const std::string* const channel : {&channels_.scan_h, &channels_.scan_v}) {
          network.subscribeFunction(*channel, &LcmInput::on_scan, this)->setQueueCapacity(kQueue);
        }
      },
      &heartbeat_);
  return {};
}

void LcmInput::stop() {
  listener_.reset();
}

std::string LcmInput::trouble() const {
  if (listener_ == nullptr || !listener_->network())
    return "no network for LCM at " + url_ + ", where the scans should come from";
  const std::uint64_t refused = refused_.load();
  return refused > 0 ? fmt::format("{} scans over LCM were not taken: damaged, of another run or scanner", refused)
                     : "";
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
