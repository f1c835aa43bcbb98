// Counter-based random numbers: the value depends only on the key, never on who asked first.
//
// Keyed by (seed, stream, index) so that results do not depend on the number of threads (design notes 6.3). The mixer
// is SplitMix64's finaliser applied to the chained key words (Steele, Lea, Flood 2014).
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace submapd {

class CounterRandom {
 public:
  // Streams with different (seed, a, b) are independent, e.g. a = scan number, b = particle.
  CounterRandom(std::uint64_t seed, std::uint64_t a, std::uint64_t b)
      : key_(mix(mix(mix(seed + kStep) ^ (a + 2 * kStep)) ^ (b + 3 * kStep))) {}

  std::uint64_t next_u64() { return mix(key_ + kStep * ++counter_); }

  // Uniform in [0, 1), 53 bits.
  double uniform() { return static_cast<double>(next_u64() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }

  // Standard normal by Box-Muller; the second value of each pair is not kept, so one call is always two draws.
  double gaussian() {
    const double u = 1.0 - uniform();  // (0, 1]
    const double v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
  }

 private:
  static constexpr std::uint64_t kStep = 0x9E3779B97F4A7C15ULL;
  static constexpr std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }

  std::uint64_t key_;
  std::uint64_t counter_ = 0;
};

}  // namespace submapd
