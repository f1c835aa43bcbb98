// Any bytes of a USB/IP client, cut in any way: the answers must be those to the bytes as a whole, and bounded.
//
// Input: byte 0 seeds the chunk sizes, bit 7 of it imports the scanner first; the rest came from the client.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>
#include <vector>

#include "tests/support/usbip_client.hpp"
#include "tools/hokuyo_sim/usbip_session.hpp"

namespace {

using submapd::tools::UsbipExport;
using submapd::tools::UsbipSession;

void require(bool condition) {
  if (!condition) std::abort();
}

// Answers to `bytes` and to what the scanner does in the two turns after them.
template <typename NextChunk>
std::vector<std::uint8_t> converse(bool imported, std::span<const std::uint8_t> bytes, NextChunk&& next_chunk) {
  submapd::driver::SimSensorOptions options;
  options.boot_ns = 0;
  submapd::driver::SimSensor sensor(options,
                                    std::make_unique<submapd::driver::CallbackRanges>([](auto, auto, auto range_mm) {
                                      for (auto& range : range_mm) range = 1000;
                                    }),
                                    {});
  sensor.power_on(0);
  std::vector<UsbipExport> exports;
  exports.emplace_back(submapd::tools::UsbipDeviceInfo{"1-1", 1, 2, {}}, sensor);
  UsbipSession session(exports);
  if (imported) require(session.receive(0, submapd::tools::test::ask_import("1-1")));
  bool talks = true;
  while (!bytes.empty()) {
    const std::size_t length = std::min<std::size_t>(next_chunk(), bytes.size());
    talks = session.receive(1, bytes.first(length));
    bytes = bytes.subspan(length);
  }
  require(talks == (session.error() == submapd::tools::UsbipError::kNone));
  if (!session.over()) {
    for (std::int64_t ms = 10; ms < 60; ms += 10) exports[0].serve(ms * 1'000'000);
  }
  return session.output();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  const bool imported = (data[0] & 0x80U) != 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  const auto whole = converse(imported, bytes, [&] { return bytes.size(); });
  std::uint32_t random = data[0];
  const std::uint32_t longest = 1U + data[0] % 80U;
  const auto cut = converse(imported, bytes, [&] {
    random = random * 1664525U + 1013904223U;
    return 1U + (random >> 16) % longest;
  });
  require(whole == cut);
  // 8 bytes that ask for the list are answered by 332; what the sensor says is bounded by its queue.
  require(whole.size() <= 400 + 42 * size + submapd::tools::BulkInQueue::kMostBytes);
  return 0;
}
