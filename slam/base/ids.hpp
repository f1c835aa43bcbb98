// Identities that stay unique over a fleet: cart, run, sub-map, track point (design section 6).
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <string>

namespace submapd {

// 128-bit identifier of a cart or a run, RFC 4122 byte order. All zero means "not set".
struct Uuid {
  std::array<std::uint8_t, 16> bytes{};
  friend auto operator<=>(const Uuid&, const Uuid&) = default;

  // Lower-case 8-4-4-4-12 form.
  [[nodiscard]] std::string to_string() const;
  // Version-4-shaped UUID derived from a seed: replay is deterministic, so its run id is too.
  [[nodiscard]] static Uuid from_seed(std::uint64_t seed, std::uint64_t stream);
};

struct SubmapId {
  Uuid cart;
  Uuid run;
  std::uint32_t index = 0;  // 0, 1, 2, ... within the run
  friend auto operator<=>(const SubmapId&, const SubmapId&) = default;
};

}  // namespace submapd
