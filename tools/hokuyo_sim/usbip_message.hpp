// The messages of USB/IP, protocol version 1.1.1: what a client asks, parsed from bytes, and our answers as bytes.
//
// No I/O. Every length is bounded and checked before anything is kept, so that hostile bytes cost one error and no
// memory. Source: the Linux kernel's Documentation/usb/usbip_protocol.rst. All numbers are big-endian.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/hokuyo_sim/cdc_function.hpp"

namespace submapd::tools {

enum class UsbipError : std::uint8_t {
  kNone,
  kVersion,
  kCommand,
  kDirection,
  kTooLong,
  kIsochronous,
  kDevice,
  kTooManyUrbs,
};
[[nodiscard]] std::string_view words_of(UsbipError error);

struct UsbipSubmit {
  std::uint32_t seqnum = 0;
  std::uint32_t devid = 0;
  bool in = false;
  std::uint32_t endpoint = 0;            // without the direction's bit
  std::size_t length = 0;                // room for the answer, or of `data`
  std::array<std::uint8_t, 8> setup{};   // of endpoint 0
  std::span<const std::uint8_t> data{};  // to the device; valid during the call
};

struct UsbipUnlink {
  std::uint32_t seqnum = 0;
  std::uint32_t unlinked = 0;  // seqnum of the URB to take back
};

// What a client asks. The error, if it may not ask that, ends the conversation.
class UsbipListener {
 public:
  virtual UsbipError on_devlist() = 0;
  // True in `imported`: what follows are URBs.
  virtual UsbipError on_import(std::string_view busid, bool& imported) = 0;
  virtual UsbipError on_submit(const UsbipSubmit& submit) = 0;
  virtual UsbipError on_unlink(const UsbipUnlink& unlink) = 0;

 protected:
  ~UsbipListener() = default;
};

class UsbipParser {
 public:
  static constexpr std::size_t kMostData = 65'536;  // of one URB

  // In any chunks. False after an error: nothing more is taken.
  bool feed(std::span<const std::uint8_t> bytes, UsbipListener& listener);
  [[nodiscard]] UsbipError error() const { return error_; }

 private:
  // Length of the message that buffer_ begins with, as far as it can be told; 0 with error_ set.
  [[nodiscard]] std::size_t wanted();
  [[nodiscard]] UsbipError take(UsbipListener& listener);

  bool urbs_ = false;
  UsbipError error_ = UsbipError::kNone;
  std::vector<std::uint8_t> buffer_;  // at most one message
};

// What a client is told of a device.
struct UsbipDeviceInfo {
  std::string busid;  // as sysfs names it, e.g. "1-1", at most 31 characters
  std::uint32_t bus = 1;
  std::uint32_t address = 2;
  CdcLayout layout;

  [[nodiscard]] std::uint32_t devid() const { return bus << 16 | address; }
};

void append_devlist(std::vector<std::uint8_t>& out, std::span<const UsbipDeviceInfo> devices);
// nullptr: refused.
void append_import(std::vector<std::uint8_t>& out, const UsbipDeviceInfo* device);
// status: 0 or a negative errno. `data` goes to a client that asked for some; `taken` is how much went to the device.
void append_submitted(std::vector<std::uint8_t>& out, std::uint32_t seqnum, int status,
                      std::span<const std::uint8_t> data, std::size_t taken);
void append_unlinked(std::vector<std::uint8_t>& out, std::uint32_t seqnum, int status);

}  // namespace submapd::tools
