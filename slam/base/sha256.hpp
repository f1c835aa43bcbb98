// SHA-256 of bytes, by OpenSSL: the identity of what lies in the archive and travels over LCM.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "slam/base/status.hpp"

namespace submapd {

using Sha256 = std::array<std::uint8_t, 32>;

// Error: kInternal, when the library cannot (no memory, or its policy forbids the algorithm).
[[nodiscard]] Expected<Sha256> sha256_of(std::span<const std::byte> bytes);

// Of a file's bytes, read in pieces. Errors: kIo, kInternal.
[[nodiscard]] Expected<Sha256> sha256_of_file(const std::filesystem::path& path);

// 64 lower-case digits.
[[nodiscard]] std::string hex_of(const Sha256& hash);

}  // namespace submapd
