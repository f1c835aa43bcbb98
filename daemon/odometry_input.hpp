// Odometry over LCM (CART_ODOMETRY), if it is configured: from messages of anyone to samples that a scan may be joined
// with.
//
// The sender's utime is the system's wall clock, as is usual with LCM. What counts is only how long ago that was when
// the message came, so the age is taken off the monotonic clock: a step of the wall clock spoils no more than the
// messages on their way. Nothing is believed beyond the cart's limits: what does not decode, is of another cart, too
// old, too crowded or faster than a cart can be is counted and left out; a wrong but smooth odometry is the mapper's to
// find out. Threads: made and ended by one, which is not the one that asks track(); counters() by any.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "daemon/configuration.hpp"
#include "daemon/lcm_listener.hpp"
#include "daemon/odometry_track.hpp"

namespace submapd {

struct OdometryCounters {
  std::uint64_t taken = 0;
  std::uint64_t bad = 0;      // not an odometry_t, or no pose of a cart
  std::uint64_t foreign = 0;  // of another cart
  std::uint64_t stale = 0;    // measured too long ago, or in the future
  std::uint64_t crowded = 0;  // not later than the one before, or more than can be of use
  std::uint64_t jumps = 0;    // of taken: the frame has jumped, and no motion is taken across it
  std::uint64_t dropped = 0;  // nobody took them: no scans come
  std::uint64_t joined = 0;   // scans that were given odometry
  bool silent = false;        // nothing was taken for some seconds
};

// What of the messages counts. One thread.
class OdometrySieve {
 public:
  static constexpr std::int64_t kOldest_us = 500'000;
  static constexpr std::int64_t kEarliest_us = 20'000;  // clocks of two machines differ
  static constexpr std::int64_t kCrowded_ns = 1'000'000;

  explicit OdometrySieve(const Uuid& cart) : cart_(cart) {}

  // `arrived_ns` by the monotonic clock, which was `wall_us` by the system's.
  [[nodiscard]] std::optional<OdometrySample> take(std::span<const std::byte> bytes, std::int64_t arrived_ns,
                                                   std::int64_t wall_us);
  [[nodiscard]] const OdometryCounters& counters() const { return counters_; }

 private:
  const Uuid cart_;
  std::optional<OdometrySample> last_;
  OdometryCounters counters_;
};

class OdometryInput {
 public:
  // Listens from now on. Without a network it tries again now and then.
  OdometryInput(const LcmConfiguration& configuration, const Uuid& cart);

  [[nodiscard]] OdometryTrack& track() { return track_; }
  [[nodiscard]] OdometryCounters counters() const;

 private:
  static constexpr std::size_t kWaiting = 256;

  void on_message(std::span<const std::byte> bytes);

  OdometryRing ring_{kWaiting};
  OdometryTrack track_{ring_};
  OdometrySieve sieve_;  // the thread's
  std::array<std::atomic<std::uint64_t>, 6> counted_{};
  std::atomic<std::int64_t> newest_ns_;  // a sample was taken, monotonic
  LcmListener listener_;
};

}  // namespace submapd
