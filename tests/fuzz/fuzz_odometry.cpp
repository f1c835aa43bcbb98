// CART_ODOMETRY from anyone: any messages at any times, between scans. What a scan gets is what the raw log can give
// back, and each message is counted once.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "daemon/odometry_input.hpp"
#include "slam/submap/submap_check.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  submapd::OdometrySieve sieve({});
  submapd::OdometryRing ring(64);
  submapd::OdometryTrack track(ring);
  std::span<const std::byte> input = std::as_bytes(std::span(data, size));
  std::int64_t now_ns = 1'000'000'000;
  std::uint64_t messages = 0;
  // A row of: half milliseconds that pass, length, message.
  while (input.size() > 2) {
    now_ns += static_cast<std::int64_t>(input[0]) * 500'000;
    const std::size_t length = std::min<std::size_t>(static_cast<std::size_t>(input[1]), input.size() - 2);
    const auto sample = sieve.take(input.subspan(2, length), now_ns, now_ns / 1000);
    input = input.subspan(2 + length);
    ++messages;
    if (sample) {
      if (submapd::OdometrySample* const slot = ring.claim()) {
        *slot = *sample;
        ring.publish();
      }
    }
    if (const auto pose = track.pose_at(now_ns - 27'000'000); pose && !submapd::is_sound(*pose)) std::abort();
  }
  const submapd::OdometryCounters& c = sieve.counters();
  if (c.taken + c.bad + c.foreign + c.stale + c.crowded != messages) std::abort();
  return 0;
}
