// A text file written through fmt in pieces of 64 KiB, appearing whole at commit(). One thread.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>

#include "slam/base/atomic_file.hpp"
#include "slam/base/status.hpp"

namespace submapd::internal {

class TextFile {
 public:
  explicit TextFile(const std::filesystem::path& path) : file_(path) {}

  template <typename... Args>
  Status print(fmt::format_string<Args...> format, Args&&... args) {
    return append(format, fmt::make_format_args(args...));
  }

  Status commit();

 private:
  static constexpr std::size_t kPiece_bytes = 64U << 10;

  // Formats in a file of its own: in a header each user would compile all of fmt.
  Status append(fmt::string_view format, fmt::format_args args);
  Status flush();

  AtomicFile file_;
  fmt::memory_buffer buffer_;
};

}  // namespace submapd::internal
