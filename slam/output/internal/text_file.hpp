// A text file written through fmt in pieces of 64 KiB, appearing whole at commit(). One thread.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <filesystem>
#include <iterator>
#include <string_view>
#include <utility>

#include "slam/base/atomic_file.hpp"
#include "slam/base/status.hpp"

namespace submapd::internal {

class TextFile {
 public:
  explicit TextFile(const std::filesystem::path& path) : file_(path) {}

  template <typename... Args>
  Status print(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(buffer_), format, std::forward<Args>(args)...);
    return buffer_.size() < kPiece_bytes ? Status() : flush();
  }

  Status commit() {
    if (Status status = flush(); !status.ok()) return status;
    return file_.commit();
  }

 private:
  static constexpr std::size_t kPiece_bytes = 64U << 10;

  Status flush() {
    Status status = file_.write(std::string_view(buffer_.data(), buffer_.size()));
    buffer_.clear();
    return status;
  }

  AtomicFile file_;
  fmt::memory_buffer buffer_;
};

}  // namespace submapd::internal
