// Writes a Canvas as a PNG file through libpng.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "slam/base/status.hpp"
#include "slam/output/internal/canvas.hpp"

namespace submapd::internal {

// One tEXt chunk.
struct PngText {
  std::string keyword;  // 1 to 79 Latin-1 characters
  std::string text;
};

// RGB, 8 bits, row by row; the file appears whole or not at all. No time of day in it: same canvas, same bytes.
[[nodiscard]] Status write_png(const std::filesystem::path& path, const Canvas& canvas, std::span<const PngText> texts);

}  // namespace submapd::internal
