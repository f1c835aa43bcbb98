// Where the emulated scanner's measurements come from: recorded ranges, or a callback (the worlds of tools/sim).
//
// Ranges are in millimetres as the sensor reports them, so a value below 23 is an error code. Called from whatever
// thread advances the emulated sensor; implementations are owned by it and need not be thread-safe.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

namespace submapd::driver {

class RangeSource {
 public:
  RangeSource() = default;
  RangeSource(const RangeSource&) = delete;
  RangeSource& operator=(const RangeSource&) = delete;
  virtual ~RangeSource() = default;

  // Fills one turn's measurements. `rotation` counts turns of the rotor since power-on; first_beam_ns is the true time
  // of step 0. Both spans have 1081 elements, step 0 first. Intensities are raw echo strengths, 18 bits.
  virtual void measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
                       std::span<std::uint32_t> intensity) = 0;
};

// Recorded scans, over and over: turn n gives scan n modulo the number of scans. Intensities follow from the ranges.
class RecordedRanges final : public RangeSource {
 public:
  // REQUIRES: at least one scan. Steps missing at the end of a short scan read 1 (nothing in range).
  explicit RecordedRanges(std::vector<std::vector<std::uint32_t>> scans_mm) : scans_mm_(std::move(scans_mm)) {}

  void measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
               std::span<std::uint32_t> intensity) override;

 private:
  std::vector<std::vector<std::uint32_t>> scans_mm_;
};

class CallbackRanges final : public RangeSource {
 public:
  // (rotation, true time of step 0, ranges to fill). Intensities follow from the ranges.
  using Callback = std::function<void(std::uint64_t, std::int64_t, std::span<std::uint32_t>)>;
  explicit CallbackRanges(Callback callback) : callback_(std::move(callback)) {}

  void measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
               std::span<std::uint32_t> intensity) override;

 private:
  Callback callback_;
};

}  // namespace submapd::driver
