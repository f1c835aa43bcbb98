#include "daemon/odometry_input.hpp"

#include <lcm/lcm-cpp.hpp>

#include "daemon/lcm_receive.hpp"
#include "daemon/run_clock.hpp"
#include "driver/monotonic.hpp"
#include "proto/channels.hpp"
#include "proto/odometry_conversion.hpp"

namespace submapd {
namespace {

constexpr int kQueue = 64;  // messages that LCM keeps
constexpr std::int64_t kSilent_ns = 5'000'000'000;
constexpr std::int64_t kLongPause_ns = 1'000'000'000;  // after which the frame need not be the same

}  // namespace

std::optional<OdometrySample> OdometrySieve::take(std::span<const std::byte> bytes, std::int64_t arrived_ns,
                                                  std::int64_t wall_us) {
  const Expected<OdometryMessage> message = decode_odometry(bytes);
  if (!message) {
    ++counters_.bad;
    return std::nullopt;
  }
  if (message->cart != Uuid{} && message->cart != cart_) {
    ++counters_.foreign;
    return std::nullopt;
  }
  const std::int64_t utime_us = message->utime_us == 0 ? wall_us : message->utime_us;
  if (utime_us < wall_us - kOldest_us || utime_us > wall_us + kEarliest_us) {
    ++counters_.stale;
    return std::nullopt;
  }
  OdometrySample sample{arrived_ns - (wall_us - utime_us) * 1000, message->odom_from_base, 1};
  if (last_ && sample.mono_ns - last_->mono_ns < kCrowded_ns) {
    ++counters_.crowded;
    return std::nullopt;
  }
  if (last_) {
    const bool jumped = is_jump(*last_, sample);
    if (jumped) ++counters_.jumps;
    const bool anew = jumped || sample.mono_ns - last_->mono_ns > kLongPause_ns;
    sample.stretch = last_->stretch + (anew ? 1U : 0U);
  }
  ++counters_.taken;
  last_ = sample;
  return sample;
}

OdometryInput::OdometryInput(const LcmConfiguration& configuration, const Uuid& cart)
    : sieve_(cart),
      newest_ns_(driver::monotonic_now_ns()),
      listener_(configuration.url, "odometry",
                [this, channel = Channels(configuration.prefix).odometry](lcm::LCM& network) {
                  const auto on_bytes = [](const lcm::ReceiveBuffer* buffer, const std::string&, OdometryInput* self) {
                    self->on_message(bytes_of(buffer));
                  };
                  network.subscribeFunction(channel, +on_bytes, this)->setQueueCapacity(kQueue);
                }) {}

void OdometryInput::on_message(std::span<const std::byte> bytes) {
  const std::int64_t now_ns = driver::monotonic_now_ns();
  const std::int64_t wall_us = (now_ns + RunClock::system_offset_ns()) / 1000;
  const std::optional<OdometrySample> sample = sieve_.take(bytes, now_ns, wall_us);
  if (sample) {
    newest_ns_.store(now_ns, std::memory_order_relaxed);
    if (OdometrySample* const slot = ring_.claim()) {
      *slot = *sample;
      ring_.publish();
    }
  }
  const OdometryCounters& c = sieve_.counters();
  const std::array<std::uint64_t, 6> counts = {c.taken, c.bad, c.foreign, c.stale, c.crowded, c.jumps};
  for (std::size_t i = 0; i < counts.size(); ++i) counted_[i].store(counts[i], std::memory_order_relaxed);
}

OdometryCounters OdometryInput::counters() const {
  constexpr auto kRelaxed = std::memory_order_relaxed;
  return {counted_[0].load(kRelaxed),
          counted_[1].load(kRelaxed),
          counted_[2].load(kRelaxed),
          counted_[3].load(kRelaxed),
          counted_[4].load(kRelaxed),
          counted_[5].load(kRelaxed),
          ring_.dropped(),
          track_.joined(),
          driver::monotonic_now_ns() - newest_ns_.load(kRelaxed) > kSilent_ns};
}

}  // namespace submapd
