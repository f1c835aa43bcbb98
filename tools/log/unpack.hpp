// Unpacks gzip and xz while reading, with bounded memory.
//
// Concatenated members are read as one. A cut or damaged stream delivers all that could be unpacked, then kCorrupt.
#pragma once

#include <memory>

#include "tools/log/input_buffer.hpp"

namespace submapd::tools {

// True if the bytes start with the magic of the format.
[[nodiscard]] bool is_gzip(std::span<const std::byte> front);
[[nodiscard]] bool is_xz(std::span<const std::byte> front);

// Both take over the packed input. kInternal: the library cannot be set up.
[[nodiscard]] Expected<std::unique_ptr<ByteSource>> open_gzip(InputBuffer packed);
[[nodiscard]] Expected<std::unique_ptr<ByteSource>> open_xz(InputBuffer packed);

}  // namespace submapd::tools
