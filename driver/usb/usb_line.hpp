// One open scanner: its libusb handle, its transfers, and their completions.
//
// Internal to driver/usb. Everything on the event thread. Life: open(), then serve() after each round of events until
// done(); a line is never freed while a transfer is under way.
#pragma once

#include <libusb.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "driver/error.hpp"
#include "driver/link.hpp"
#include "driver/usb/usb_host.hpp"
#include "driver/usb/usb_layout.hpp"

namespace submapd::driver {

class UsbLine final : public ByteLink {
 public:
  enum class State : std::uint8_t {
    kSettingUp,  // line coding and control lines are under way
    kOpen,
    kClosing,  // transfers are being cancelled
    kClosed,   // nothing is under way: may be freed
  };

  // Opens the device, takes both interfaces from the kernel's driver and submits the first transfers.
  [[nodiscard]] static Expected<std::unique_ptr<UsbLine>> open(libusb_device* device, const UsbOptions& options,
                                                               LinkClient& client, UsbCounters& counters);
  UsbLine(const UsbLine&) = delete;
  UsbLine& operator=(const UsbLine&) = delete;
  // REQUIRES: done().
  ~UsbLine();

  bool write(std::span<const std::uint8_t> bytes) noexcept override;
  void reset() noexcept override { reset_wanted_ = true; }

  // The program ends: lets the client say goodbye, once, and closes when that is sent.
  void end(std::int64_t now_ns) noexcept;
  // Starts to close: cancels all transfers. Idempotent.
  void close() noexcept;
  // What may not be done in a completion: clears a halt, submits again, tells the client of open and closed.
  void serve(std::int64_t now_ns) noexcept;

  [[nodiscard]] bool done() const { return state_ == State::kClosed; }
  [[nodiscard]] bool reset_wanted() const { return reset_wanted_; }
  [[nodiscard]] libusb_device_handle* handle() const { return handle_; }

 private:
  static constexpr std::size_t kWrites = 4;
  static constexpr std::size_t kWriteBytes = 64;
  static constexpr unsigned kWriteTimeout_ms = 200;
  static constexpr unsigned kControlTimeout_ms = 500;
  static constexpr int kErrorsToGiveUp = 64;

  struct Write {
    libusb_transfer* transfer = nullptr;
    std::array<std::uint8_t, kWriteBytes> bytes{};
    bool busy = false;
  };

  UsbLine(libusb_device_handle* handle, const UsbOptions& options, LinkClient& client, UsbCounters& counters);
  [[nodiscard]] Expected<void> claim(libusb_device* device);
  [[nodiscard]] Expected<void> prepare();
  void submit_reads() noexcept;
  void submit_control(std::uint8_t request, std::uint16_t value, std::span<const std::uint8_t> data) noexcept;
  [[nodiscard]] bool submit(libusb_transfer* transfer) noexcept;

  static void LIBUSB_CALL on_read(libusb_transfer* transfer);
  static void LIBUSB_CALL on_write(libusb_transfer* transfer);
  static void LIBUSB_CALL on_control(libusb_transfer* transfer);
  static void LIBUSB_CALL on_interrupt(libusb_transfer* transfer);
  // A read that did not complete. True: submit it again.
  [[nodiscard]] bool read_failed(libusb_transfer_status status, std::int64_t now_ns) noexcept;

  libusb_device_handle* handle_;
  LinkClient& client_;
  UsbCounters& counters_;
  UsbLayout layout_;
  std::size_t transfer_bytes_;
  std::vector<std::uint8_t> buffer_;  // of all reads
  std::vector<libusb_transfer*> reads_;
  std::array<Write, kWrites> writes_;
  libusb_transfer* control_ = nullptr;
  libusb_transfer* interrupt_ = nullptr;
  std::array<std::uint8_t, 16> control_bytes_{};
  std::array<std::uint8_t, 64> interrupt_bytes_{};

  State state_ = State::kSettingUp;
  bool told_open_ = false;
  bool halted_ = false;  // a read stalled: all come back, then the halt is cleared
  bool write_halted_ = false;
  bool control_lines_set_ = false;
  bool ready_ = false;  // the control requests are through, whatever their outcome
  bool reset_wanted_ = false;
  bool ending_ = false;
  int reads_under_way_ = 0;
  int under_way_ = 0;  // all transfers
  int errors_in_a_row_ = 0;
  std::uint64_t offset_ = 0;
};

}  // namespace submapd::driver
