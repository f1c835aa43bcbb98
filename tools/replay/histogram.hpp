// Distribution of durations in fixed memory: exact mean and maximum, percentiles to one per cent.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace submapd::tools {

class DurationHistogram {
 public:
  void add(double ms) {
    ++count_;
    sum_ms_ += ms;
    max_ms_ = std::max(max_ms_, ms);
    const double step = std::log(std::max(ms, kLowest_ms) / kLowest_ms) / std::log(kGrowth);
    ++bins_[std::min(static_cast<std::size_t>(step), kBins - 1)];
  }
  void add(const DurationHistogram& other) {
    for (std::size_t i = 0; i < kBins; ++i) bins_[i] += other.bins_[i];
    count_ += other.count_;
    sum_ms_ += other.sum_ms_;
    max_ms_ = std::max(max_ms_, other.max_ms_);
  }
  [[nodiscard]] double mean_ms() const { return count_ > 0 ? sum_ms_ / static_cast<double>(count_) : 0.0; }
  [[nodiscard]] double max_ms() const { return max_ms_; }
  // Value below which the share q of all durations lies.
  [[nodiscard]] double quantile_ms(double q) const {
    const double wanted = q * static_cast<double>(count_);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < kBins; ++i) {
      seen += bins_[i];
      if (seen > 0 && static_cast<double>(seen) >= wanted) {
        return std::min(kLowest_ms * std::pow(kGrowth, static_cast<double>(i) + 0.5), max_ms_);
      }
    }
    return max_ms_;
  }

 private:
  static constexpr double kLowest_ms = 1e-4;
  static constexpr double kGrowth = 1.01;
  static constexpr std::size_t kBins = 2048;  // up to 70 s
  std::array<std::uint64_t, kBins> bins_{};
  std::uint64_t count_ = 0;
  double sum_ms_ = 0.0;
  double max_ms_ = 0.0;
};

}  // namespace submapd::tools
