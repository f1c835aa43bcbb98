// What the clock adds to a scan on its way to the ring.
#include <benchmark/benchmark.h>

#include <vector>

#include "driver/clock/sensor_clock.hpp"
#include "tests/unit/driver/clock/sensor_sim.hpp"

namespace submapd::driver {
namespace {

void BM_StampScan(benchmark::State& state) {
  test::SensorSim sim({}, 1);
  SensorClock clock({});
  for (int i = 0; i < 150; ++i) {
    const auto reply = sim.ask_time();
    clock.add_time_reply(reply.sent_ns, reply.received_ns, reply.device_ms);
    sim.rest(20e3);
  }
  std::vector<test::SensorSim::Scan> scans;
  for (int i = 0; i < 100'000; ++i) scans.push_back(sim.next_scan());
  std::size_t next = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(clock.add_scan(scans[next].device_ms, scans[next].first_byte_ns));
    ++next;
  }
}
// As many as there are: scans cannot be given twice.
BENCHMARK(BM_StampScan)->Iterations(100'000);

}  // namespace
}  // namespace submapd::driver

BENCHMARK_MAIN();
