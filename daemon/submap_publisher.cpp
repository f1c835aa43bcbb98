#include "daemon/submap_publisher.hpp"

#include <fmt/format.h>

#include <lcm/lcm-cpp.hpp>
#include <thread>
#include <utility>
#include <vector>

#include "proto/lcm_message.hpp"
#include "proto/submap_chunks.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd {

SubmapPublisher::SubmapPublisher(lcm::LCM& lcm, SubmapPublisherOptions options)
    : lcm_(lcm), options_(std::move(options)) {}

Status SubmapPublisher::publish(const FinishedSubmap& submap, const Sha256& hash) {
  if (!lcm_.good()) return Status(StatusCode::kUnavailable, "LCM is not available: is there a multicast route?");
  const std::int64_t utime = submap.keyframes.empty() ? 0 : submap.keyframes.back().stamp_us;
  const Expected<std::vector<submap_chunk_t>> chunks =
      chunk_submap(submap.id, utime, encode_submap(submap), hash, next_seq_);
  if (!chunks) return chunks.error();
  for (const submap_chunk_t& chunk : *chunks) {
    if (chunk.chunk > 0 && options_.pace.count() > 0) std::this_thread::sleep_for(options_.pace);
    const std::vector<std::byte> bytes = encode_message(chunk);
    ++next_seq_;
    if (lcm_.publish(options_.channels.submap, bytes.data(), static_cast<unsigned>(bytes.size())) != 0) {
      return Status(StatusCode::kUnavailable,
                    fmt::format("LCM refused chunk {} of sub-map {}", chunk.chunk, submap.id.index));
    }
  }
  return {};
}

}  // namespace submapd
