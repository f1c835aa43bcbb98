// What one step of the producer costs: claim a slot, fill it with a scan, publish it, with the consumer asleep,
// reading, and stalled. Percentiles of single steps, in nanoseconds; the time stamps around a step are part of them.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "driver/ring/scan_ring.hpp"

namespace submapd::driver {
namespace {

using std::chrono::steady_clock;

enum class Consumer { kIdle, kNormal, kStalled };

bool step(ScanRing& ring, const DeviceScan& scan) {
  DeviceScan* const slot = ring.claim();
  if (slot == nullptr) return false;
  *slot = scan;
  ring.publish();
  return true;
}

void report(benchmark::State& state, std::vector<double>& steps_ns) {
  std::sort(steps_ns.begin(), steps_ns.end());
  const auto at = [&](double share) {
    return steps_ns[std::min(steps_ns.size() - 1,
                             static_cast<std::size_t>(share * static_cast<double>(steps_ns.size())))];
  };
  state.counters["p50_ns"] = at(0.50);
  state.counters["p99_ns"] = at(0.99);
  state.counters["p99.9_ns"] = at(0.999);
  state.counters["max_ns"] = steps_ns.back();
}

void produce(benchmark::State& state, Consumer kind) {
  Doorbell bell(EventFd::open().value());
  ScanRing ring(160, &bell);
  std::atomic<bool> finished{false};
  std::uint64_t received = 0;
  std::thread consumer;
  if (kind != Consumer::kStalled) {
    consumer = std::thread([&, kind] {
      const auto has_data = [&] { return ring.has_data(); };
      std::uint64_t sum = 0;
      for (bool over = false; !over;) {
        over = finished.load();
        if (kind == Consumer::kIdle) bell.wait(has_data, std::chrono::milliseconds(over ? 0 : 20));
        while (const DeviceScan* const scan = ring.front()) {
          sum += scan->ranges_mm[540];
          ring.pop();
          ++received;
        }
      }
      benchmark::DoNotOptimize(sum);
    });
  }
  const auto scan = std::make_unique<DeviceScan>();
  std::vector<double> steps_ns;
  steps_ns.reserve(1U << 22);
  std::uint64_t steps = 0;
  for (auto _ : state) {
    const auto begin = steady_clock::now();
    const bool published = step(ring, *scan);
    const auto end = steady_clock::now();
    ++steps;
    const std::chrono::duration<double> seconds = end - begin;
    state.SetIterationTime(seconds.count());
    // A drop is a step of its own kind: it counts where the ring is meant to be full.
    if (published || kind == Consumer::kStalled) steps_ns.push_back(seconds.count() * 1e9);
    // Idle: the consumer has long gone to sleep when the next scan comes, so that each step wakes it.
    if (kind == Consumer::kIdle) std::this_thread::sleep_for(std::chrono::microseconds(300));
    // Normal: as fast as a reader on the other core keeps up with.
    while (kind == Consumer::kNormal && steady_clock::now() < end + std::chrono::microseconds(5)) {
    }
  }
  finished.store(true);
  if (consumer.joinable()) consumer.join();
  if (ring.published() + ring.dropped() != steps || (kind != Consumer::kStalled && received != ring.published())) {
    state.SkipWithError("a scan was neither handed on nor counted as dropped");
  }
  state.counters["dropped"] = static_cast<double>(ring.dropped());
  report(state, steps_ns);
}

void BM_ProducerIdleConsumer(benchmark::State& state) {
  produce(state, Consumer::kIdle);
}
void BM_ProducerNormalConsumer(benchmark::State& state) {
  produce(state, Consumer::kNormal);
}
void BM_ProducerStalledConsumer(benchmark::State& state) {
  produce(state, Consumer::kStalled);
}
BENCHMARK(BM_ProducerIdleConsumer)->UseManualTime()->Iterations(5'000);
BENCHMARK(BM_ProducerNormalConsumer)->UseManualTime()->Iterations(200'000);
BENCHMARK(BM_ProducerStalledConsumer)->UseManualTime()->Iterations(1'000'000);

}  // namespace
}  // namespace submapd::driver

BENCHMARK_MAIN();
