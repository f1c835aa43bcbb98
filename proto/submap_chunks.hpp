// An encoded sub-map as submap_chunk_t messages of one datagram each, and back.
//
// No threads: each object belongs to one caller at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/sha256.hpp"
#include "slam/base/status.hpp"
#include "submapd/submap_chunk_t.hpp"

namespace submapd {

inline constexpr std::size_t kChunkBytes = 60'000;

// Compresses `raw` (encode_submap()'s bytes, whose SHA-256 is `hash`) and cuts it. Message numbers start at
// `first_seq`. Errors: kExhausted (above kMaxEncodedSubmapBytes), kInternal (zstd).
[[nodiscard]] Expected<std::vector<submap_chunk_t>> chunk_submap(const SubmapId& id, std::int64_t utime,
                                                                 std::span<const std::byte> raw, const Sha256& hash,
                                                                 std::int64_t first_seq);

// A chunk whose sizes, place and CRC agree with each other. Errors: kCorrupt.
[[nodiscard]] Expected<submap_chunk_t> decode_submap_chunk(std::span<const std::byte> bytes);

// All monotonic but bytes_used.
struct ChunkCounters {
  std::uint64_t received = 0;  // messages
  std::uint64_t bad = 0;       // no chunk, or a wrong CRC
  std::uint64_t foreign = 0;   // of another cart or run
  std::uint64_t forged = 0;    // of our run, but with a hash nobody announced, or sizes that disagree with its siblings
  std::uint64_t duplicates = 0;  // repeated, or of a sub-map that is done
  std::uint64_t evicted = 0;     // unfinished sub-maps dropped for the byte budget
  std::uint64_t damaged = 0;     // whole, but the bytes do not decompress to what the hash says
  std::uint64_t completed = 0;
  std::size_t bytes_used = 0;
  std::size_t bytes_peak = 0;
};

// Puts chunks together, in whatever order they come, with a bound on what unfinished sub-maps may hold.
class ChunkAssembler {
 public:
  // Asked before anything is kept: is this the hash of that sub-map of our run?
  using KnownHash = std::function<bool(std::uint32_t index, const Sha256& hash)>;

  struct Complete {
    std::uint32_t index = 0;
    Sha256 hash{};
    std::vector<std::byte> raw;  // its SHA-256 is `hash`
  };

  // `bytes_limit` bounds the chunks kept, compressed; the oldest unfinished sub-map gives way.
  ChunkAssembler(const Uuid& cart, const Uuid& run, KnownHash known_hash, std::size_t bytes_limit);

  // Takes the bytes of one message; returns the sub-map it completes, if it does.
  [[nodiscard]] std::optional<Complete> add(std::span<const std::byte> message);

  // Sub-maps below `index` are no longer wanted: drops what is kept of them and counts what still comes as duplicates.
  void forget_below(std::uint32_t index);

  [[nodiscard]] const ChunkCounters& counters() const { return counters_; }

 private:
  using Key = std::pair<std::uint32_t, Sha256>;
  struct Partial {
    std::uint64_t born = 0;  // order of first chunks
    std::int32_t compressed_bytes = 0;
    std::int32_t raw_bytes = 0;
    std::size_t missing = 0;
    std::size_t bytes = 0;
    std::vector<std::vector<std::uint8_t>> chunks;  // empty: not there yet
  };

  void drop(std::map<Key, Partial>::iterator partial);
  [[nodiscard]] bool make_room(std::size_t bytes);
  [[nodiscard]] std::optional<Complete> finish(const Key& key, const Partial& partial);

  const Uuid cart_;
  const Uuid run_;
  const KnownHash known_hash_;
  const std::size_t bytes_limit_;
  std::map<Key, Partial> partials_;
  std::uint64_t born_ = 0;
  std::uint32_t wanted_from_ = 0;
  ChunkCounters counters_;
};

}  // namespace submapd
