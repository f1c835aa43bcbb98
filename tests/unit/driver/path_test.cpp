// From bytes to the ring: parser, clock and ring together, and proof that this path never allocates.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "driver/clock/sensor_clock.hpp"
#include "driver/ring/scan_ring.hpp"
#include "driver/scip/encode.hpp"
#include "driver/scip/parser.hpp"

namespace {

std::atomic<std::uint64_t> allocations{0};

}  // namespace

// Not inlined: g++ would see malloc and free in place of new and delete and warn of a mismatch.
[[gnu::noinline]] void* operator new(std::size_t size) {
  allocations.fetch_add(1, std::memory_order_relaxed);
  if (void* const memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept {
  std::free(memory);
}
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}

namespace submapd::driver::test {
namespace {

// What the USB thread does with a scan.
class Path final : public scip::Listener {
 public:
  explicit Path(ScanRing& ring) : ring_(ring), clock_({}) {}
  int faults = 0;

  void on_scan(const scip::ScanData& scan) noexcept override {
    const ScanTime time = clock_.add_scan(static_cast<std::uint32_t>(scan.time), scan.frame.first_byte_ns);
    DeviceScan* const slot = ring_.claim();
    if (slot == nullptr || !set_values(scan, *slot)) return;
    slot->index = time.index;
    slot->first_beam_mono_ns = time.first_beam_mono_ns;
    slot->error_bound_ns = time.error_bound_ns;
    ring_.publish();
  }
  void on_stale_scan(const scip::ScanData&) noexcept override {}
  void on_stream_start(const scip::Frame&) noexcept override {}
  void on_stream_status(const scip::Frame&) noexcept override {}
  void on_time(const scip::Frame& frame, std::uint64_t time) noexcept override {
    clock_.add_time_reply(frame.first_byte_ns - 1'000'000, frame.last_byte_ns, static_cast<std::uint32_t>(time));
  }
  void on_reply(const scip::Frame&, std::span<const scip::Parameter>) noexcept override {}
  void on_fault(const scip::Fault&) noexcept override { ++faults; }

 private:
  ScanRing& ring_;
  SensorClock clock_;
};

TEST(DriverPath, BytesBecomeStampedScansInTheRingWithoutAnAllocation) {
  constexpr int kScans = 2000;
  const scip::Command md = scip::Command::scan({});
  ScanRing ring(64);
  const auto path = std::make_unique<Path>(ring);
  const auto parser = std::make_unique<scip::Parser>();
  std::vector<std::uint32_t> ranges_mm(1081, 1000);
  ranges_mm[0] = 262'143;  // more than a slot's value holds
  ranges_mm[1] = 3;
  std::string bytes;
  bytes.reserve(4096);
  std::uint64_t allocated = 0;
  std::uint64_t received = 0;
  for (int i = 0; i < kScans; ++i) {
    bytes.clear();
    if (i < 100) {
      parser->expect(*scip::Command::parse("TM1"));
      scip::append_time(bytes, "TM1", static_cast<std::uint64_t>(20 * i));
    } else {
      if (i == 100) parser->expect(md);
      scip::append_scan(bytes, {.echo = md.text(), .time = static_cast<std::uint64_t>(25 * i), .ranges_mm = ranges_mm});
      if (i % 100 == 50) bytes[200] = '~';  // damaged
    }
    const std::int64_t now_ns = i < 100 ? std::int64_t{20'000'000} * i : std::int64_t{25'000'000} * i + 20'000'000;
    const std::uint64_t before = allocations.load();
    for (std::size_t at = 0; at < bytes.size(); at += 512) {
      const auto* const data = reinterpret_cast<const std::uint8_t*>(bytes.data());
      parser->feed({data + at, std::min<std::size_t>(512, bytes.size() - at)}, now_ns, *path);
    }
    allocated += allocations.load() - before;
    while (const DeviceScan* const scan = ring.front()) {
      ASSERT_EQ(scan->ranges_mm[0], 65'535);
      ASSERT_EQ(scan->ranges_mm[1], 3);
      ASSERT_EQ(scan->ranges_mm[1080], 1000);
      ASSERT_EQ(scan->beams, 1081U);
      ASSERT_EQ(scan->device_ms, static_cast<std::uint32_t>(25 * i));
      ASSERT_EQ(scan->index, static_cast<std::uint64_t>(i - 100));
      ring.pop();
      ++received;
    }
  }
  EXPECT_EQ(allocated, 0U);
  EXPECT_EQ(path->faults, 19);
  EXPECT_EQ(received, static_cast<std::uint64_t>(kScans - 100 - path->faults));
  EXPECT_EQ(ring.dropped(), 0U);
}

TEST(DriverPath, AScanThatDoesNotFitLeavesTheSlotAlone) {
  const std::vector<std::uint32_t> ranges_mm(DeviceScan::kMaxBeams + 1, 7);
  DeviceScan slot;
  slot.beams = 5;
  scip::ScanData scan;
  scan.ranges_mm = ranges_mm;
  EXPECT_FALSE(set_values(scan, slot));
  scan.ranges_mm = std::span(ranges_mm).first(3);
  scan.request.mode = 'N';
  EXPECT_FALSE(set_values(scan, slot));
  EXPECT_EQ(slot.beams, 5U);
}

}  // namespace
}  // namespace submapd::driver::test
