#include "driver/usb/usb_line.hpp"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "driver/monotonic.hpp"

namespace submapd::driver {
namespace {

// Of the CDC PSTN subclass, version 1.2.
constexpr std::uint8_t kSetLineCoding = 0x20;
constexpr std::uint8_t kSetControlLineState = 0x22;
constexpr std::uint8_t kToInterface = 0x21;  // class request, host to device
constexpr std::uint16_t kDtrAndRts = 3;
constexpr std::array<std::uint8_t, 7> kLineCoding = {0x00, 0xC2, 0x01, 0x00, 0, 0, 8};  // 115200 8N1; no meaning on USB

std::string reason(int code) {
  return libusb_strerror(static_cast<libusb_error>(code));
}

Error open_error(int code) {
  if (code == LIBUSB_ERROR_ACCESS) {
    return {ErrorCode::kAccess,
            "no permission to open the device; is the udev rule of submapd installed, and this user in its group?"};
  }
  if (code == LIBUSB_ERROR_BUSY) {
    return {ErrorCode::kBusy, "another program has the device; end it"};
  }
  return {ErrorCode::kSystem, "cannot open the device: " + reason(code)};
}

}  // namespace

UsbLine::UsbLine(libusb_device_handle* handle, const UsbOptions& options, LinkClient& client, UsbCounters& counters)
    : handle_(handle),
      client_(client),
      counters_(counters),
      transfer_bytes_(options.transfer_bytes),
      buffer_(options.transfers * options.transfer_bytes),
      reads_(options.transfers) {}

UsbLine::~UsbLine() {
  for (libusb_transfer* const transfer : reads_) {
    libusb_free_transfer(transfer);
  }
  for (const Write& write : writes_) {
    libusb_free_transfer(write.transfer);
  }
  libusb_free_transfer(control_);
  libusb_free_transfer(interrupt_);
  // Releasing gives the interfaces back to the kernel's driver, as auto-detach was asked for.
  libusb_release_interface(handle_, layout_.data_interface);
  libusb_release_interface(handle_, layout_.control_interface);
  libusb_close(handle_);
}

Expected<std::unique_ptr<UsbLine>> UsbLine::open(libusb_device* device, const UsbOptions& options, LinkClient& client,
                                                 UsbCounters& counters) {
  libusb_device_handle* handle = nullptr;
  if (const int code = libusb_open(device, &handle); code != 0) {
    return tl::unexpected(open_error(code));
  }
  std::unique_ptr<UsbLine> line(new UsbLine(handle, options, client, counters));
  if (auto claimed = line->claim(device); !claimed) {
    return tl::unexpected(std::move(claimed.error()));
  }
  if (auto prepared = line->prepare(); !prepared) {
    return tl::unexpected(std::move(prepared.error()));
  }
  line->submit_reads();
  line->submit_control(kSetLineCoding, 0, kLineCoding);
  return line;
}

Expected<void> UsbLine::claim(libusb_device* device) {
  libusb_config_descriptor* config = nullptr;
  if (const int code = libusb_get_active_config_descriptor(device, &config); code != 0) {
    return failure(ErrorCode::kSystem, "cannot read the device's descriptors: " + reason(code));
  }
  const auto layout = find_serial_line(*config);
  libusb_free_config_descriptor(config);
  if (!layout) {
    return failure(ErrorCode::kProtocol, "the device has no serial line (CDC-ACM): not a scanner we can speak with");
  }
  layout_ = *layout;
  libusb_set_auto_detach_kernel_driver(handle_, 1);
  for (const std::uint8_t interface : {layout_.control_interface, layout_.data_interface}) {
    if (const int code = libusb_claim_interface(handle_, interface); code != 0) {
      return tl::unexpected(open_error(code));
    }
  }
  return {};
}

Expected<void> UsbLine::prepare() {
  for (libusb_transfer*& transfer : reads_) {
    transfer = libusb_alloc_transfer(0);
  }
  for (Write& write : writes_) {
    write.transfer = libusb_alloc_transfer(0);
  }
  control_ = libusb_alloc_transfer(0);
  interrupt_ = libusb_alloc_transfer(0);
  const auto missing = [](const libusb_transfer* transfer) { return transfer == nullptr; };
  if (std::any_of(reads_.begin(), reads_.end(), missing) || missing(control_) || missing(interrupt_) ||
      std::any_of(writes_.begin(), writes_.end(), [](const Write& write) { return write.transfer == nullptr; })) {
    return failure(ErrorCode::kSystem, "no memory for USB transfers");
  }
  for (std::size_t i = 0; i < reads_.size(); ++i) {
    libusb_fill_bulk_transfer(reads_[i], handle_, layout_.bulk_in, buffer_.data() + i * transfer_bytes_,
                              static_cast<int>(transfer_bytes_), &UsbLine::on_read, this, 0);
  }
  return {};
}

bool UsbLine::submit(libusb_transfer* transfer) noexcept {
  const int code = libusb_submit_transfer(transfer);
  if (code != 0) {
    ++counters_.errors;
    if (code == LIBUSB_ERROR_NO_DEVICE) {
      close();
    }
    return false;
  }
  ++under_way_;
  return true;
}

void UsbLine::submit_reads() noexcept {
  for (libusb_transfer* const transfer : reads_) {
    if (state_ < State::kClosing && submit(transfer)) {
      ++reads_under_way_;
    }
  }
  if (state_ < State::kClosing && reads_under_way_ == 0) {
    close();
  }
  const std::size_t wanted = std::min<std::size_t>(layout_.interrupt_bytes, interrupt_bytes_.size());
  if (interrupt_->buffer == nullptr && layout_.interrupt_in != 0 && wanted > 0) {
    // Its notifications mean nothing to us, but unread they pile up in some devices.
    libusb_fill_interrupt_transfer(interrupt_, handle_, layout_.interrupt_in, interrupt_bytes_.data(),
                                   static_cast<int>(wanted), &UsbLine::on_interrupt, this, 0);
    static_cast<void>(submit(interrupt_));
  }
}

void UsbLine::submit_control(std::uint8_t request, std::uint16_t value, std::span<const std::uint8_t> data) noexcept {
  libusb_fill_control_setup(control_bytes_.data(), kToInterface, request, value, layout_.control_interface,
                            static_cast<std::uint16_t>(data.size()));
  std::copy(data.begin(), data.end(), control_bytes_.begin() + LIBUSB_CONTROL_SETUP_SIZE);
  libusb_fill_control_transfer(control_, handle_, control_bytes_.data(), &UsbLine::on_control, this,
                               kControlTimeout_ms);
  if (!submit(control_)) {
    ready_ = true;  // as with a stall: the scanner works without
  }
}

bool UsbLine::write(std::span<const std::uint8_t> bytes) noexcept {
  const auto free = std::find_if(writes_.begin(), writes_.end(), [](const Write& write) { return !write.busy; });
  if (state_ != State::kOpen || bytes.size() > kWriteBytes || free == writes_.end()) {
    return false;
  }
  std::copy(bytes.begin(), bytes.end(), free->bytes.begin());
  libusb_fill_bulk_transfer(free->transfer, handle_, layout_.bulk_out, free->bytes.data(),
                            static_cast<int>(bytes.size()), &UsbLine::on_write, this, kWriteTimeout_ms);
  free->busy = submit(free->transfer);
  return free->busy;
}

void UsbLine::end(std::int64_t now_ns) noexcept {
  if (!ending_ && state_ == State::kOpen) {
    client_.on_stop(now_ns);
  }
  ending_ = true;
  if (std::none_of(writes_.begin(), writes_.end(), [](const Write& write) { return write.busy; })) {
    close();
  }
}

void UsbLine::close() noexcept {
  if (state_ >= State::kClosing) {
    return;
  }
  state_ = State::kClosing;
  for (libusb_transfer* const transfer : reads_) {
    libusb_cancel_transfer(transfer);  // those not under way refuse, harmlessly
  }
  for (const Write& write : writes_) {
    if (write.busy) {
      libusb_cancel_transfer(write.transfer);
    }
  }
  libusb_cancel_transfer(control_);
  libusb_cancel_transfer(interrupt_);
}

void UsbLine::serve(std::int64_t now_ns) noexcept {
  if (state_ == State::kSettingUp && ready_) {
    state_ = State::kOpen;
    told_open_ = true;
    client_.on_open(*this, now_ns);
  }
  if (halted_ && reads_under_way_ == 0 && state_ < State::kClosing) {
    halted_ = false;
    libusb_clear_halt(handle_, layout_.bulk_in);
    submit_reads();
  }
  if (write_halted_ && state_ < State::kClosing) {
    write_halted_ = false;
    libusb_clear_halt(handle_, layout_.bulk_out);
  }
  if (state_ == State::kClosing && under_way_ == 0) {
    state_ = State::kClosed;
    if (told_open_) {
      client_.on_close(now_ns);
    }
  }
}

void UsbLine::on_read(libusb_transfer* transfer) {
  const std::int64_t now_ns = monotonic_now_ns();  // first: this is when the bytes were there
  auto& line = *static_cast<UsbLine*>(transfer->user_data);
  --line.under_way_;
  --line.reads_under_way_;
  bool again = line.state_ < State::kClosing && !line.halted_;
  if (transfer->status == LIBUSB_TRANSFER_COMPLETED) {
    const auto length = static_cast<std::size_t>(transfer->actual_length);
    ++line.counters_.transfers_in;
    line.counters_.bytes_in += length;
    line.errors_in_a_row_ = 0;
    if (line.told_open_ && length > 0) {
      line.client_.on_bytes({transfer->buffer, length}, now_ns, line.offset_);
      line.offset_ += length;
    }
    again = again && line.state_ < State::kClosing;
  } else {
    again = line.read_failed(transfer->status, now_ns) && again;
  }
  if (again && line.submit(transfer)) {
    ++line.reads_under_way_;
  } else if (again && line.reads_under_way_ == 0) {
    line.close();
  }
}

bool UsbLine::read_failed(libusb_transfer_status status, std::int64_t now_ns) noexcept {
  switch (status) {
    case LIBUSB_TRANSFER_STALL:
      // Every queued read stalls with the first one: one fault, not sixteen.
      if (!halted_) {
        halted_ = true;
        ++counters_.stalls;
        if (told_open_) {
          client_.on_fault(LinkFault::kStall, now_ns);
        }
      }
      return false;
    case LIBUSB_TRANSFER_OVERFLOW:
      ++counters_.overflows;
      if (told_open_) {
        client_.on_fault(LinkFault::kOverflow, now_ns);
      }
      return true;
    case LIBUSB_TRANSFER_CANCELLED:
      return false;
    case LIBUSB_TRANSFER_NO_DEVICE:
      close();
      return false;
    default:
      ++counters_.errors;
      if (told_open_) {
        client_.on_fault(LinkFault::kTransfer, now_ns);
      }
      if (++errors_in_a_row_ >= kErrorsToGiveUp) {
        close();  // opened again after a pause
      }
      return errors_in_a_row_ < kErrorsToGiveUp;
  }
}

void UsbLine::on_write(libusb_transfer* transfer) {
  auto& line = *static_cast<UsbLine*>(transfer->user_data);
  --line.under_way_;
  const auto write = std::find_if(line.writes_.begin(), line.writes_.end(),
                                  [transfer](const Write& w) { return w.transfer == transfer; });
  write->busy = false;
  if (transfer->status == LIBUSB_TRANSFER_COMPLETED || transfer->status == LIBUSB_TRANSFER_CANCELLED) {
    return;
  }
  if (transfer->status == LIBUSB_TRANSFER_NO_DEVICE) {
    line.close();
    return;
  }
  ++line.counters_.writes_failed;
  line.write_halted_ = line.write_halted_ || transfer->status == LIBUSB_TRANSFER_STALL;
  if (line.told_open_) {
    line.client_.on_fault(LinkFault::kWrite, monotonic_now_ns());
  }
}

void UsbLine::on_control(libusb_transfer* transfer) {
  auto& line = *static_cast<UsbLine*>(transfer->user_data);
  --line.under_way_;
  if (transfer->status == LIBUSB_TRANSFER_NO_DEVICE) {
    line.close();
  } else if (line.state_ < State::kClosing && !line.control_lines_set_) {
    line.control_lines_set_ = true;
    line.submit_control(kSetControlLineState, kDtrAndRts, {});
  } else {
    line.ready_ = true;
  }
}

void UsbLine::on_interrupt(libusb_transfer* transfer) {
  auto& line = *static_cast<UsbLine*>(transfer->user_data);
  --line.under_way_;
  if (transfer->status == LIBUSB_TRANSFER_COMPLETED && line.state_ < State::kClosing) {
    static_cast<void>(line.submit(transfer));
  }
}

}  // namespace submapd::driver
