// The side channel of emulated scanners: one JSON line for each scan measured, with what really happened.
//
// Any number of sinks may be called from any threads.
#pragma once

#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "driver/sim/sim_sensor.hpp"
#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd::tools {

class TruthLog {
 public:
  // An empty path: nothing is written. "-": the standard output.
  [[nodiscard]] static Expected<std::unique_ptr<TruthLog>> open(const std::string& path);
  TruthLog(const TruthLog&) = delete;
  TruthLog& operator=(const TruthLog&) = delete;
  ~TruthLog();

  // Where the cart is at an instant of the monotonic clock; empty for recorded ranges.
  using PoseAt = std::function<Pose2(std::int64_t mono_ns)>;
  // For scanner 1, 2, ... REQUIRES: not called after the log is gone.
  [[nodiscard]] driver::SimSensor::TruthSink sink(std::size_t number, const std::string& serial, PoseAt pose_at);

 private:
  explicit TruthLog(std::FILE* file) : file_(file) {}
  std::mutex mutex_;
  std::FILE* file_;
};

}  // namespace submapd::tools
