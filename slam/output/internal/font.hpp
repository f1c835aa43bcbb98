// A small proportional font for ASCII 32..126, drawn for this project: dots in a 5 x 9 box, the last two rows below the
// base line.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace submapd::internal {

inline constexpr int kGlyphRows = 9;       // with descenders
inline constexpr int kCapitalRows = 7;     // height of a capital letter
inline constexpr int kGlyphColumns = 5;    // at most
inline constexpr double kLetterGap = 1.4;  // dots between two letters

struct Glyph {
  std::array<std::uint8_t, kGlyphRows> rows{};  // bit 4 is the leftmost column
  int first_column = 0;                         // the columns that are used
  int columns = 3;

  [[nodiscard]] bool dot(int column, int row) const {
    if (column < 0 || column >= kGlyphColumns || row < 0 || row >= kGlyphRows) return false;
    return ((rows[static_cast<std::size_t>(row)] >> (kGlyphColumns - 1 - column)) & 1) != 0;
  }
};

// The glyph of a character; '?' for those outside ASCII 32..126.
[[nodiscard]] Glyph glyph_of(char character);

// Width in dots of a text on one line, without a gap at its end.
[[nodiscard]] double text_width_dots(std::string_view text);

}  // namespace submapd::internal
