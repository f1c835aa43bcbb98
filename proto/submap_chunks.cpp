#include "proto/submap_chunks.hpp"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <string_view>

#include "proto/lcm_message.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd {
namespace {

constexpr int kCompressionLevel = 3;
constexpr std::size_t kMaxCompressedBytes = ZSTD_COMPRESSBOUND(kMaxEncodedSubmapBytes);

std::size_t chunks_of(std::size_t compressed_bytes) {
  return (compressed_bytes + kChunkBytes - 1) / kChunkBytes;
}

std::int64_t crc_of(std::span<const std::uint8_t> bytes) {
  return static_cast<std::int64_t>(crc32_z(crc32_z(0, nullptr, 0), bytes.data(), bytes.size()));
}

Sha256 hash_of(const submap_chunk_t& chunk) {
  Sha256 hash{};
  std::copy(std::begin(chunk.sha256), std::end(chunk.sha256), hash.begin());
  return hash;
}

std::string_view problem_of(const submap_chunk_t& chunk) {
  if (chunk.submap < 0 || chunk.seq < 0) return "negative number";
  if (chunk.raw_bytes <= 0 || static_cast<std::size_t>(chunk.raw_bytes) > kMaxEncodedSubmapBytes) {
    return "decompressed size out of range";
  }
  if (chunk.compressed_bytes <= 0 || static_cast<std::size_t>(chunk.compressed_bytes) > kMaxCompressedBytes) {
    return "compressed size out of range";
  }
  const std::size_t total = static_cast<std::size_t>(chunk.compressed_bytes);
  if (chunk.chunks < 0 || static_cast<std::size_t>(chunk.chunks) != chunks_of(total)) return "wrong number of chunks";
  if (chunk.chunk < 0 || chunk.chunk >= chunk.chunks) return "place out of range";
  const std::size_t offset = static_cast<std::size_t>(chunk.chunk) * kChunkBytes;
  if (chunk.data.size() != std::min(kChunkBytes, total - offset)) return "wrong size of the piece";
  if (chunk.crc32 != crc_of(chunk.data)) return "checksum does not match";
  return {};
}

}  // namespace

Expected<std::vector<submap_chunk_t>> chunk_submap(const SubmapId& id, std::int64_t utime,
                                                   std::span<const std::byte> raw, const Sha256& hash,
                                                   std::int64_t first_seq) {
  if (raw.empty() || raw.size() > kMaxEncodedSubmapBytes ||
      id.index > static_cast<std::uint32_t>(std::numeric_limits<std::int32_t>::max())) {
    return failure(StatusCode::kExhausted, fmt::format("sub-map {} of {} bytes cannot be sent", id.index, raw.size()));
  }
  std::vector<std::uint8_t> compressed(ZSTD_compressBound(raw.size()));
  const std::size_t size =
      ZSTD_compress(compressed.data(), compressed.size(), raw.data(), raw.size(), kCompressionLevel);
  if (ZSTD_isError(size) != 0) {
    return failure(StatusCode::kInternal, fmt::format("zstd cannot compress: {}", ZSTD_getErrorName(size)));
  }
  compressed.resize(size);

  std::vector<submap_chunk_t> chunks(chunks_of(size));
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    submap_chunk_t& chunk = chunks[i];
    chunk.utime = utime;
    put_uuid(id.cart, chunk.cart);
    put_uuid(id.run, chunk.run);
    chunk.submap = static_cast<std::int32_t>(id.index);
    chunk.seq = first_seq + static_cast<std::int64_t>(i);
    chunk.chunk = static_cast<std::int32_t>(i);
    chunk.chunks = static_cast<std::int32_t>(chunks.size());
    chunk.compressed_bytes = static_cast<std::int32_t>(size);
    chunk.raw_bytes = static_cast<std::int32_t>(raw.size());
    std::copy(hash.begin(), hash.end(), std::begin(chunk.sha256));
    const auto first = compressed.begin() + static_cast<std::ptrdiff_t>(i * kChunkBytes);
    const std::size_t length = std::min(kChunkBytes, size - i * kChunkBytes);
    chunk.data.assign(first, first + static_cast<std::ptrdiff_t>(length));
    chunk.nbytes = static_cast<std::int32_t>(length);
    chunk.crc32 = crc_of(chunk.data);
  }
  return chunks;
}

Expected<submap_chunk_t> decode_submap_chunk(std::span<const std::byte> bytes) {
  Expected<submap_chunk_t> chunk = decode_message<submap_chunk_t>(bytes, std::array<std::size_t, 1>{1});
  if (!chunk) return chunk;
  if (const std::string_view problem = problem_of(*chunk); !problem.empty()) {
    return failure(StatusCode::kCorrupt, fmt::format("submap_chunk_t: {}", problem));
  }
  return chunk;
}

ChunkAssembler::ChunkAssembler(const Uuid& cart, const Uuid& run, KnownHash known_hash, std::size_t bytes_limit)
    : cart_(cart), run_(run), known_hash_(std::move(known_hash)), bytes_limit_(bytes_limit) {}

std::optional<ChunkAssembler::Complete> ChunkAssembler::add(std::span<const std::byte> message) {
  ++counters_.received;
  Expected<submap_chunk_t> chunk = decode_submap_chunk(message);
  if (!chunk) {
    ++counters_.bad;
    return std::nullopt;
  }
  if (get_uuid(chunk->cart) != cart_ || get_uuid(chunk->run) != run_) {
    ++counters_.foreign;
    return std::nullopt;
  }
  const Key key{static_cast<std::uint32_t>(chunk->submap), hash_of(*chunk)};
  if (!known_hash_(key.first, key.second)) {
    ++counters_.forged;
    return std::nullopt;
  }
  if (key.first < wanted_from_) {
    ++counters_.duplicates;
    return std::nullopt;
  }

  auto found = partials_.find(key);
  if (found != partials_.end()) {
    if (found->second.compressed_bytes != chunk->compressed_bytes || found->second.raw_bytes != chunk->raw_bytes) {
      ++counters_.forged;
      return std::nullopt;
    }
    if (!found->second.chunks[static_cast<std::size_t>(chunk->chunk)].empty()) {
      ++counters_.duplicates;
      return std::nullopt;
    }
  }
  if (!make_room(chunk->data.size())) return std::nullopt;
  found = partials_.find(key);  // making room may have dropped it
  if (found == partials_.end()) {
    Partial partial;
    partial.born = born_++;
    partial.compressed_bytes = chunk->compressed_bytes;
    partial.raw_bytes = chunk->raw_bytes;
    partial.missing = static_cast<std::size_t>(chunk->chunks);
    partial.chunks.resize(partial.missing);
    found = partials_.emplace(key, std::move(partial)).first;
  }
  Partial& partial = found->second;
  partial.bytes += chunk->data.size();
  counters_.bytes_used += chunk->data.size();
  counters_.bytes_peak = std::max(counters_.bytes_peak, counters_.bytes_used);
  partial.chunks[static_cast<std::size_t>(chunk->chunk)] = std::move(chunk->data);
  if (--partial.missing > 0) return std::nullopt;

  std::optional<Complete> complete = finish(key, partial);
  ++(complete ? counters_.completed : counters_.damaged);
  drop(found);
  return complete;
}

void ChunkAssembler::forget_below(std::uint32_t index) {
  wanted_from_ = std::max(wanted_from_, index);
  while (!partials_.empty() && partials_.begin()->first.first < wanted_from_) drop(partials_.begin());
}

void ChunkAssembler::drop(std::map<Key, Partial>::iterator partial) {
  counters_.bytes_used -= partial->second.bytes;
  partials_.erase(partial);
}

bool ChunkAssembler::make_room(std::size_t bytes) {
  while (counters_.bytes_used + bytes > bytes_limit_ && !partials_.empty()) {
    drop(std::min_element(partials_.begin(), partials_.end(),
                          [](const auto& a, const auto& b) { return a.second.born < b.second.born; }));
    ++counters_.evicted;
  }
  return counters_.bytes_used + bytes <= bytes_limit_;
}

std::optional<ChunkAssembler::Complete> ChunkAssembler::finish(const Key& key, const Partial& partial) {
  std::vector<std::uint8_t> compressed;
  compressed.reserve(partial.bytes);
  for (const std::vector<std::uint8_t>& chunk : partial.chunks) {
    compressed.insert(compressed.end(), chunk.begin(), chunk.end());
  }
  Complete complete{key.first, key.second, std::vector<std::byte>(static_cast<std::size_t>(partial.raw_bytes))};
  const std::size_t size =
      ZSTD_decompress(complete.raw.data(), complete.raw.size(), compressed.data(), compressed.size());
  if (ZSTD_isError(size) != 0 || size != complete.raw.size()) return std::nullopt;
  const Expected<Sha256> hash = sha256_of(complete.raw);
  if (!hash || *hash != complete.hash) return std::nullopt;
  return complete;
}

}  // namespace submapd
