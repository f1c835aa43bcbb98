// Which interfaces and endpoints of a device are its serial line, read from its descriptors.
#pragma once

#include <libusb.h>

#include <cstdint>
#include <optional>

namespace submapd::driver {

struct UsbLayout {
  std::uint8_t control_interface = 0;
  std::uint8_t data_interface = 0;
  std::uint8_t bulk_in = 0;
  std::uint8_t bulk_out = 0;
  std::uint8_t interrupt_in = 0;  // 0: none
  std::uint16_t interrupt_bytes = 0;
};

// Nothing if the configuration has no CDC-ACM function: a control interface of class 2, subclass 2, and a data
// interface of class 10 with one bulk endpoint each way in its first setting. Pure; any thread.
[[nodiscard]] std::optional<UsbLayout> find_serial_line(const libusb_config_descriptor& config);

}  // namespace submapd::driver
