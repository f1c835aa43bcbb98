#include "tools/hokuyo_sim/usbip_message.hpp"

#include <algorithm>

namespace submapd::tools {
namespace {

constexpr std::uint16_t kVersion = 0x0111;
constexpr std::uint16_t kAskDevlist = 0x8005;
constexpr std::uint16_t kAskImport = 0x8003;
constexpr std::uint16_t kReplyDevlist = 0x0005;
constexpr std::uint16_t kReplyImport = 0x0003;
constexpr std::uint32_t kCmdSubmit = 1;
constexpr std::uint32_t kCmdUnlink = 2;
constexpr std::uint32_t kRetSubmit = 3;
constexpr std::uint32_t kRetUnlink = 4;

constexpr std::size_t kOperationBytes = 8;
constexpr std::size_t kBusidBytes = 32;
constexpr std::size_t kPathBytes = 256;
constexpr std::size_t kUrbBytes = 48;
constexpr std::uint32_t kFullSpeed = 2;

std::uint16_t read16(const std::uint8_t* at) {
  return static_cast<std::uint16_t>(at[0] << 8 | at[1]);
}

std::uint32_t read32(const std::uint8_t* at) {
  return std::uint32_t{read16(at)} << 16 | read16(at + 2);
}

void put16(std::vector<std::uint8_t>& out, std::uint16_t value) {
  out.push_back(static_cast<std::uint8_t>(value >> 8));
  out.push_back(static_cast<std::uint8_t>(value & 0xFF));
}

void put32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  put16(out, static_cast<std::uint16_t>(value >> 16));
  put16(out, static_cast<std::uint16_t>(value & 0xFFFF));
}

void put_text(std::vector<std::uint8_t>& out, std::string_view text, std::size_t field_bytes) {
  const std::string_view kept = text.substr(0, field_bytes - 1);
  out.insert(out.end(), kept.begin(), kept.end());
  out.insert(out.end(), field_bytes - kept.size(), 0);
}

void put_zeros(std::vector<std::uint8_t>& out, std::size_t count) {
  out.insert(out.end(), count, 0);
}

void put_operation(std::vector<std::uint8_t>& out, std::uint16_t code, std::uint32_t status) {
  put16(out, kVersion);
  put16(out, code);
  put32(out, status);
}

void put_device(std::vector<std::uint8_t>& out, const UsbipDeviceInfo& device) {
  const std::vector<std::uint8_t> all = descriptors(device.layout);
  put_text(out, "/sys/devices/pci0000:00/usb" + std::to_string(device.bus) + "/" + device.busid, kPathBytes);
  put_text(out, device.busid, kBusidBytes);
  put32(out, device.bus);
  put32(out, device.address);
  put32(out, kFullSpeed);
  put16(out, device.layout.vendor_id);
  put16(out, device.layout.product_id);
  put16(out, static_cast<std::uint16_t>(all[13] << 8 | all[12]));     // bcdDevice
  out.insert(out.end(), all.begin() + 4, all.begin() + 7);            // class, sub-class, protocol
  out.insert(out.end(), {1, all[17], static_cast<std::uint8_t>(2)});  // configuration, configurations, interfaces
}

}  // namespace

std::string_view words_of(UsbipError error) {
  switch (error) {
    case UsbipError::kNone:
      return "no error";
    case UsbipError::kVersion:
      return "speaks another version of USB/IP";
    case UsbipError::kCommand:
      return "sends an unknown command";
    case UsbipError::kDirection:
      return "sends an unknown direction";
    case UsbipError::kTooLong:
      return "wants a transfer of more than 64 KiB";
    case UsbipError::kIsochronous:
      return "wants isochronous transfers, of which a scanner has none";
    case UsbipError::kDevice:
      return "names another device than it imported";
    case UsbipError::kTooManyUrbs:
      return "has too many transfers under way";
  }
  return "";
}

std::size_t UsbipParser::wanted() {
  if (!urbs_) {
    if (buffer_.size() < kOperationBytes) {
      return kOperationBytes;
    }
    const std::uint16_t code = read16(buffer_.data() + 2);
    if (read16(buffer_.data()) != kVersion) {
      error_ = UsbipError::kVersion;
    } else if (code != kAskDevlist && code != kAskImport) {
      error_ = UsbipError::kCommand;
    }
    return error_ != UsbipError::kNone ? 0 : kOperationBytes + (code == kAskImport ? kBusidBytes : 0);
  }
  if (buffer_.size() < kUrbBytes) {
    return kUrbBytes;
  }
  const std::uint32_t command = read32(buffer_.data());
  if (command == kCmdUnlink) {
    return kUrbBytes;
  }
  const std::uint32_t direction = read32(buffer_.data() + 12);
  const std::uint32_t length = read32(buffer_.data() + 24);
  const std::uint32_t packets = read32(buffer_.data() + 32);
  constexpr std::uint32_t kNoPackets = 0xFFFFFFFF;  // so newer kernels say; older ones 0
  if (command != kCmdSubmit) {
    error_ = UsbipError::kCommand;
  } else if (direction > 1) {
    error_ = UsbipError::kDirection;
  } else if (length > kMostData) {
    error_ = UsbipError::kTooLong;
  } else if (packets != 0 && packets != kNoPackets) {
    error_ = UsbipError::kIsochronous;
  }
  return error_ != UsbipError::kNone ? 0 : kUrbBytes + (direction == 0 ? length : 0);
}

UsbipError UsbipParser::take(UsbipListener& listener) {
  const std::uint8_t* const at = buffer_.data();
  if (!urbs_) {
    if (read16(at + 2) == kAskDevlist) {
      return listener.on_devlist();
    }
    const std::string_view field(reinterpret_cast<const char*>(at + kOperationBytes), kBusidBytes);
    return listener.on_import(field.substr(0, field.find('\0')), urbs_);
  }
  if (read32(at) == kCmdUnlink) {
    return listener.on_unlink({read32(at + 4), read32(at + 20)});
  }
  UsbipSubmit submit;
  submit.seqnum = read32(at + 4);
  submit.devid = read32(at + 8);
  submit.in = read32(at + 12) == 1;
  submit.endpoint = read32(at + 16);
  submit.length = read32(at + 24);
  std::copy_n(at + 40, submit.setup.size(), submit.setup.begin());
  submit.data = std::span(buffer_).subspan(kUrbBytes);
  return listener.on_submit(submit);
}

bool UsbipParser::feed(std::span<const std::uint8_t> bytes, UsbipListener& listener) {
  while (error_ == UsbipError::kNone) {
    const std::size_t length = wanted();
    if (length > buffer_.size()) {
      const std::size_t more = std::min(length - buffer_.size(), bytes.size());
      if (more == 0) {
        return true;
      }
      buffer_.insert(buffer_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(more));
      bytes = bytes.subspan(more);
    } else if (length > 0) {
      error_ = take(listener);
      buffer_.clear();
    }
  }
  return false;
}

void append_devlist(std::vector<std::uint8_t>& out, std::span<const UsbipDeviceInfo> devices) {
  put_operation(out, kReplyDevlist, 0);
  put32(out, static_cast<std::uint32_t>(devices.size()));
  for (const UsbipDeviceInfo& device : devices) {
    put_device(out, device);
    const std::vector<std::uint8_t> all = descriptors(device.layout);
    // Interface descriptors, in the order in which they come: class, sub-class, protocol, padding.
    for (std::size_t at = 18; at + 8 < all.size(); at += all[at]) {
      if (all[at + 1] == 4) {
        out.insert(out.end(), {all[at + 5], all[at + 6], all[at + 7], 0});
      }
    }
  }
}

void append_import(std::vector<std::uint8_t>& out, const UsbipDeviceInfo* device) {
  put_operation(out, kReplyImport, device == nullptr ? 1 : 0);
  if (device != nullptr) {
    put_device(out, *device);
  }
}

void append_submitted(std::vector<std::uint8_t>& out, std::uint32_t seqnum, int status,
                      std::span<const std::uint8_t> data, std::size_t taken) {
  put32(out, kRetSubmit);
  put32(out, seqnum);
  put_zeros(out, 12);  // device, direction, endpoint: for requests only
  put32(out, static_cast<std::uint32_t>(status));
  put32(out, static_cast<std::uint32_t>(data.size() + taken));
  put_zeros(out, 20);  // frame, packets, errors, padding
  out.insert(out.end(), data.begin(), data.end());
}

void append_unlinked(std::vector<std::uint8_t>& out, std::uint32_t seqnum, int status) {
  put32(out, kRetUnlink);
  put32(out, seqnum);
  put_zeros(out, 12);
  put32(out, static_cast<std::uint32_t>(status));
  put_zeros(out, 24);
}

}  // namespace submapd::tools
