// Decoding speed with all checks on: bytes a second of full MD and ME scans, as USB delivers them and whole.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "driver/device_scan.hpp"
#include "driver/scip/encode.hpp"
#include "driver/scip/parser.hpp"

namespace submapd::driver::scip {
namespace {

constexpr int kScans = 50;

// Takes each scan as the driver does: its values are narrowed into a slot.
class Slot final : public Listener {
 public:
  std::uint64_t scans = 0;
  std::uint64_t others = 0;
  DeviceScan slot;

  void on_scan(const ScanData& scan) noexcept override {
    set_values(scan, slot);
    ++scans;
  }
  void on_stale_scan(const ScanData&) noexcept override { ++others; }
  void on_stream_start(const Frame&) noexcept override {}
  void on_stream_status(const Frame&) noexcept override { ++others; }
  void on_time(const Frame&, std::uint64_t) noexcept override { ++others; }
  void on_reply(const Frame&, std::span<const Parameter>) noexcept override { ++others; }
  void on_fault(const Fault&) noexcept override { ++others; }
};

std::string stream(const Command& command) {
  std::minstd_rand random(1);
  std::vector<std::uint32_t> ranges_mm(command.request().beams());
  std::vector<std::uint32_t> intensities(command.request().intensities() ? ranges_mm.size() : 0);
  std::string rx;
  for (int i = 0; i < kScans; ++i) {
    for (std::uint32_t& range_mm : ranges_mm) range_mm = static_cast<std::uint32_t>(random() % 30000);
    for (std::uint32_t& intensity : intensities) intensity = static_cast<std::uint32_t>(random() % 17000);
    append_scan(rx, {.echo = command.text(),
                     .time = static_cast<std::uint64_t>(25 * i),
                     .ranges_mm = ranges_mm,
                     .intensities = intensities});
  }
  return rx;
}

void decode(benchmark::State& state, char data) {
  const Command command = Command::scan({.data = data});
  const std::string rx = stream(command);
  const std::span<const std::uint8_t> bytes(reinterpret_cast<const std::uint8_t*>(rx.data()), rx.size());
  const auto chunk = static_cast<std::size_t>(state.range(0));
  const auto parser = std::make_unique<Parser>();
  const auto slot = std::make_unique<Slot>();
  parser->expect(command);
  for (auto _ : state) {
    for (std::size_t at = 0; at < bytes.size(); at += chunk) {
      parser->feed(bytes.subspan(at, std::min(chunk, bytes.size() - at)), 0, *slot);
    }
    benchmark::DoNotOptimize(slot->slot);
  }
  if (slot->others != 0 || slot->scans != kScans * static_cast<std::uint64_t>(state.iterations())) {
    state.SkipWithError("not every scan was decoded");
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(rx.size()) * state.iterations());
  state.counters["us/scan"] =
      benchmark::Counter(static_cast<double>(kScans) * static_cast<double>(state.iterations()) / 1e6,
                         benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

void BM_DecodeMd1081(benchmark::State& state) {
  decode(state, 'D');
}
void BM_DecodeMe1081(benchmark::State& state) {
  decode(state, 'E');
}
BENCHMARK(BM_DecodeMd1081)->ArgName("chunk")->Arg(64)->Arg(512)->Arg(4096);
BENCHMARK(BM_DecodeMe1081)->ArgName("chunk")->Arg(64)->Arg(512)->Arg(4096);

}  // namespace
}  // namespace submapd::driver::scip

BENCHMARK_MAIN();
