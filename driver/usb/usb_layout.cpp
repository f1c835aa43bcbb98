#include "driver/usb/usb_layout.hpp"

#include <span>

namespace submapd::driver {
namespace {

constexpr std::uint8_t kAbstractControlModel = 2;  // CDC subclass
constexpr unsigned kTypeMask = 0x3;                // of bmAttributes

void read_control(const libusb_interface_descriptor& setting, UsbLayout& layout) {
  layout.control_interface = setting.bInterfaceNumber;
  for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) {
    const bool in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0;
    if (in && (endpoint.bmAttributes & kTypeMask) == LIBUSB_TRANSFER_TYPE_INTERRUPT) {
      layout.interrupt_in = endpoint.bEndpointAddress;
      layout.interrupt_bytes = endpoint.wMaxPacketSize;
    }
  }
}

void read_data(const libusb_interface_descriptor& setting, UsbLayout& layout) {
  layout.data_interface = setting.bInterfaceNumber;
  for (const auto& endpoint : std::span(setting.endpoint, setting.bNumEndpoints)) {
    if ((endpoint.bmAttributes & kTypeMask) != LIBUSB_TRANSFER_TYPE_BULK) {
      continue;
    }
    const bool in = (endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0;
    (in ? layout.bulk_in : layout.bulk_out) = endpoint.bEndpointAddress;
  }
}

}  // namespace

std::optional<UsbLayout> find_serial_line(const libusb_config_descriptor& config) {
  UsbLayout layout;
  bool control = false;
  bool data = false;
  for (const libusb_interface& interface : std::span(config.interface, config.bNumInterfaces)) {
    if (interface.num_altsetting < 1) {
      continue;
    }
    const libusb_interface_descriptor& setting = interface.altsetting[0];
    if (!control && setting.bInterfaceClass == LIBUSB_CLASS_COMM &&
        setting.bInterfaceSubClass == kAbstractControlModel) {
      read_control(setting, layout);
      control = true;
    } else if (!data && setting.bInterfaceClass == LIBUSB_CLASS_DATA) {
      read_data(setting, layout);
      data = layout.bulk_in != 0 && layout.bulk_out != 0;
    }
  }
  if (!control || !data) {
    return std::nullopt;
  }
  return layout;
}

}  // namespace submapd::driver
