#include "tools/hokuyo_sim/usbip_session.hpp"

#include <algorithm>
#include <cerrno>
#include <utility>

namespace submapd::tools {

using driver::SimOutput;

UsbipExport::UsbipExport(UsbipDeviceInfo info, driver::SimSensor& sensor)
    : info_(std::move(info)), sensor_(&sensor), in_(info_.layout.zero_length_packets) {}

void UsbipExport::import(std::vector<std::uint8_t>& out) {
  out_ = &out;
  halted_ = false;
  in_.clear();
}

void UsbipExport::release() {
  out_ = nullptr;
  reading_.clear();
  waiting_.clear();
}

UsbipError UsbipExport::submit(std::int64_t now_ns, const UsbipSubmit& submit) {
  if (submit.devid != info_.devid()) {
    return UsbipError::kDevice;
  }
  const std::uint32_t address = submit.endpoint | (submit.in ? 0x80U : 0U);
  if (submit.endpoint == 0) {
    control(submit);
  } else if (address == info_.layout.bulk_in || address == info_.layout.interrupt_in) {
    if (reading_.size() + waiting_.size() >= kMostUrbs) {
      return UsbipError::kTooManyUrbs;
    }
    Urb urb{submit.seqnum, std::vector<std::uint8_t>(submit.length), 0};
    (address == info_.layout.bulk_in ? reading_ : waiting_).push_back(std::move(urb));
    fill();
  } else if (address == info_.layout.bulk_out) {
    sensor_->receive(now_ns, submit.data);
    append_submitted(*out_, submit.seqnum, 0, {}, submit.data.size());
  } else {
    append_submitted(*out_, submit.seqnum, -EPIPE, {}, 0);
  }
  return UsbipError::kNone;
}

void UsbipExport::control(const UsbipSubmit& submit) {
  const auto answer = answer_control(info_.layout, submit.setup);
  if (!answer) {
    append_submitted(*out_, submit.seqnum, -EPIPE, {}, 0);
    return;
  }
  const std::span<const std::uint8_t> data(answer->data(), std::min(answer->size(), submit.length));
  append_submitted(*out_, submit.seqnum, 0, submit.in ? data : data.first(0), submit.in ? 0 : submit.data.size());
  constexpr std::uint8_t kToEndpoint = 0x02;
  constexpr std::uint8_t kClearFeature = 0x01;
  if (submit.setup[0] == kToEndpoint && submit.setup[1] == kClearFeature && submit.setup[4] == info_.layout.bulk_in) {
    halted_ = false;
    fill();
  }
}

void UsbipExport::fill() {
  if (halted_) {
    return fail(reading_, -EPIPE);
  }
  while (!reading_.empty() && in_.fill(reading_.front().buffer, reading_.front().filled)) {
    const Urb& urb = reading_.front();
    append_submitted(*out_, urb.seqnum, 0, std::span(urb.buffer).first(urb.filled), 0);
    reading_.pop_front();
  }
}

void UsbipExport::fail(std::deque<Urb>& urbs, int status) {
  for (; !urbs.empty(); urbs.pop_front()) {
    append_submitted(*out_, urbs.front().seqnum, status, {}, 0);
  }
}

void UsbipExport::unlink(const UsbipUnlink& unlink) {
  for (std::deque<Urb>* const urbs : {&reading_, &waiting_}) {
    const auto found =
        std::find_if(urbs->begin(), urbs->end(), [&unlink](const Urb& urb) { return urb.seqnum == unlink.unlinked; });
    if (found != urbs->end()) {
      urbs->erase(found);
      return append_unlinked(*out_, unlink.seqnum, -ECONNRESET);
    }
  }
  append_unlinked(*out_, unlink.seqnum, 0);  // it was answered before
}

void UsbipExport::serve(std::int64_t now_ns) {
  while (auto output = sensor_->take(now_ns)) {
    put(std::move(*output));
  }
}

void UsbipExport::put(SimOutput output) {
  if (output.kind == SimOutput::Kind::kUnplug || output.kind == SimOutput::Kind::kReplug) {
    plugged_in_ = output.kind == SimOutput::Kind::kReplug;
  }
  if (out_ == nullptr) {
    return;  // nobody listens
  }
  if (output.kind == SimOutput::Kind::kBytes) {
    in_.push(std::move(output.bytes), output.message_end);
  } else if (output.kind == SimOutput::Kind::kStall) {
    halted_ = true;
  } else if (output.kind == SimOutput::Kind::kOverflow && !reading_.empty()) {
    append_submitted(*out_, reading_.front().seqnum, -EOVERFLOW, {}, 0);
    reading_.pop_front();
  }
  fill();
}

UsbipSession::~UsbipSession() {
  if (device_ != nullptr) {
    device_->release();
  }
}

bool UsbipSession::receive(std::int64_t now_ns, std::span<const std::uint8_t> bytes) {
  now_ns_ = now_ns;
  return parser_.feed(bytes, *this) && !over();
}

bool UsbipSession::over() const {
  return parser_.error() != UsbipError::kNone || (device_ != nullptr && !device_->plugged_in());
}

UsbipError UsbipSession::on_devlist() {
  std::vector<UsbipDeviceInfo> offered;
  for (const UsbipExport& device : exports_) {
    if (device.plugged_in() && !device.imported()) {
      offered.push_back(device.info());
    }
  }
  append_devlist(output_, offered);
  return UsbipError::kNone;
}

UsbipError UsbipSession::on_import(std::string_view busid, bool& imported) {
  const auto found = std::find_if(exports_.begin(), exports_.end(), [busid](const UsbipExport& device) {
    return device.info().busid == busid && device.plugged_in() && !device.imported();
  });
  imported = found != exports_.end();
  append_import(output_, imported ? &found->info() : nullptr);
  if (imported) {
    device_ = &*found;
    device_->import(output_);
  }
  return UsbipError::kNone;
}

UsbipError UsbipSession::on_submit(const UsbipSubmit& submit) {
  return device_->submit(now_ns_, submit);
}

UsbipError UsbipSession::on_unlink(const UsbipUnlink& unlink) {
  device_->unlink(unlink);
  return UsbipError::kNone;
}

}  // namespace submapd::tools
