#include "driver/sim/range_source.hpp"

#include <algorithm>

namespace submapd::driver {
namespace {

// Echoes weaken with distance; the captured UTM-30LX scan spans 137..16219 with about 1800 at 50 mm. Good enough to
// have plausible, different numbers: nothing reads physics out of them.
void fill_intensity(std::span<const std::uint32_t> range_mm, std::span<std::uint32_t> intensity) {
  constexpr std::uint32_t kDmin_mm = 23;
  for (std::size_t i = 0; i < range_mm.size(); ++i) {
    intensity[i] = range_mm[i] < kDmin_mm ? 0 : 137 + 4'000'000 / (1000 + range_mm[i]);
  }
}

}  // namespace

void RecordedRanges::measure(std::uint64_t rotation, std::int64_t /*first_beam_ns*/, std::span<std::uint32_t> range_mm,
                             std::span<std::uint32_t> intensity) {
  const std::vector<std::uint32_t>& scan = scans_mm_[rotation % scans_mm_.size()];
  const std::size_t known = std::min(scan.size(), range_mm.size());
  std::copy_n(scan.begin(), known, range_mm.begin());
  std::fill(range_mm.begin() + static_cast<std::ptrdiff_t>(known), range_mm.end(), 1U);
  fill_intensity(range_mm, intensity);
}

void CallbackRanges::measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
                             std::span<std::uint32_t> intensity) {
  callback_(rotation, first_beam_ns, range_mm);
  fill_intensity(range_mm, intensity);
}

}  // namespace submapd::driver
