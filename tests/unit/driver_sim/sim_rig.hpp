// An emulated sensor and what a host hears of it, in virtual time.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "driver/sim/sim_sensor.hpp"

namespace submapd::driver::test {

// 1081 different, plausible ranges that change with every turn; every fourth step is code 1.
inline std::unique_ptr<RangeSource> turning_ranges() {
  return std::make_unique<CallbackRanges>([](std::uint64_t rotation, std::int64_t, std::span<std::uint32_t> range_mm) {
    for (std::size_t i = 0; i < range_mm.size(); ++i) {
      range_mm[i] = i % 4 == 3 ? 1U : static_cast<std::uint32_t>(500 + (i * 7 + rotation * 13) % 20000);
    }
  });
}

struct SimRig {
  explicit SimRig(SimSensorOptions options = {})
      : sensor(std::move(options), turning_ranges(), [this](const SimScanTruth& t) { truth.push_back(t); }) {
    sensor.power_on(0);
  }

  void send(std::string_view text) {
    sensor.receive(now_ns, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  }
  // Lets the time pass; what arrives is added to `heard`, bus events as <stall> and the like.
  void wait_ms(double ms) {
    now_ns += static_cast<std::int64_t>(ms * 1e6);
    while (const auto output = sensor.take(now_ns)) {
      last_due_ns = output->due_ns;
      static constexpr const char* kNames[] = {"", "<stall>", "<overflow>", "<unplug>", "<replug>"};
      heard += kNames[static_cast<std::size_t>(output->kind)];
      heard.append(output->bytes.begin(), output->bytes.end());
    }
  }
  // Sends a command and gives what is heard within ms.
  std::string ask(std::string_view command, double ms = 60.0) {
    heard.clear();
    send(std::string(command) + "\n");
    wait_ms(ms);
    return heard;
  }
  void boot() { wait_ms(1600.0); }

  std::vector<SimScanTruth> truth;
  SimSensor sensor;
  std::int64_t now_ns = 0;
  std::int64_t last_due_ns = 0;
  std::string heard;
};

inline std::size_t occurrences(std::string_view text, std::string_view part) {
  std::size_t n = 0;
  for (std::size_t at = text.find(part); at != std::string_view::npos; at = text.find(part, at + part.size())) {
    ++n;
  }
  return n;
}

}  // namespace submapd::driver::test
