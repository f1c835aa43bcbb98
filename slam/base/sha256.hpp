// SHA-256 of bytes, by OpenSSL: the identity of what lies in the archive and travels over LCM.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "slam/base/status.hpp"

namespace submapd {

using Sha256 = std::array<std::uint8_t, 32>;

// Error: kInternal, when the library cannot (no memory, or its policy forbids the algorithm).
[[nodiscard]] Expected<Sha256> sha256_of(std::span<const std::byte> bytes);

}  // namespace submapd
