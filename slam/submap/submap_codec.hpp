// A finished sub-map as bytes and back: the form in the archive and, compressed, on LCM (submap-format.md).
//
// Deterministic: equal sub-maps give equal bytes, and every byte string that decodes encodes to itself, so the SHA-256
// of the bytes identifies the sub-map. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

inline constexpr std::string_view kSubmapMagic = "SUBMAPD\n";  // an encoded sub-map begins with this
inline constexpr std::uint32_t kSubmapFormatVersion = 1;
// Larger than any sub-map that the finish rules let grow; nothing above it is read.
inline constexpr std::size_t kMaxEncodedSubmapBytes = 16U << 20;

// Bytes of any sub-map; those of one that check_submap() refuses do not decode.
[[nodiscard]] std::vector<std::byte> encode_submap(const FinishedSubmap& submap);

// Errors: kCorrupt with the offset and what is wrong there. Never allocates more than a small multiple of bytes.size().
[[nodiscard]] Expected<FinishedSubmap> decode_submap(std::span<const std::byte> bytes);

// Memory that a decoded sub-map holds, in bytes: what caches count.
[[nodiscard]] std::size_t memory_bytes(const FinishedSubmap& submap);

}  // namespace submapd
