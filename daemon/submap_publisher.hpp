// Sends finished sub-maps as chunks on CART_SUBMAP, spaced so that no receiver's default socket buffer overflows.
//
// Called from one thread, which it blocks for the spacing; LCM allows that another thread handles the same instance.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "proto/channels.hpp"
#include "slam/base/sha256.hpp"
#include "slam/base/status.hpp"
#include "slam/submap/finished_submap.hpp"

namespace lcm {
class LCM;
}

namespace submapd {

struct SubmapPublisherOptions {
  Channels channels;
  std::chrono::microseconds pace{2000};  // between two chunks; 0 for memq://, which loses nothing
};

class SubmapPublisher {
 public:
  // `lcm` must outlive the publisher.
  SubmapPublisher(lcm::LCM& lcm, SubmapPublisherOptions options);

  // `hash`: what SubmapArchive::save() gave for it. Errors: kUnavailable (no LCM or it refused; the optimizer reads the
  // sub-map from the archive then), kExhausted, kInternal.
  Status publish(const FinishedSubmap& submap, const Sha256& hash);

  // Messages sent so far: the next one's seq, health_t's last_chunk_seq + 1.
  [[nodiscard]] std::int64_t messages() const { return next_seq_; }

 private:
  lcm::LCM& lcm_;
  const SubmapPublisherOptions options_;
  std::int64_t next_seq_ = 0;
};

}  // namespace submapd
