// A sliding window over a ByteSource: look at the next bytes, then consume what was understood.
//
// Memory is bounded by twice kMaxWindow however long the input is. Not thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "tools/log/byte_source.hpp"

namespace submapd::tools {

class InputBuffer {
 public:
  static constexpr std::size_t kMaxWindow = std::size_t{5} << 20;  // the longest record of any format fits

  explicit InputBuffer(std::unique_ptr<ByteSource> source) : source_(std::move(source)) {}

  // The unread bytes: at least `count` unless the input ends before. Valid until the next call.
  // REQUIRES: count <= kMaxWindow.
  [[nodiscard]] std::span<const std::byte> peek(std::size_t count);

  // REQUIRES: count is at most what the last peek showed.
  void consume(std::size_t count) {
    begin_ += count;
    offset_ += count;
  }

  [[nodiscard]] std::uint64_t offset() const { return offset_; }  // of the next byte, counted after unpacking
  [[nodiscard]] const Status& status() const { return status_; }  // not ok: the input ended early, and why
  [[nodiscard]] double progress() const { return source_->progress(end_ - begin_); }

 private:
  std::unique_ptr<ByteSource> source_;
  std::vector<std::byte> bytes_;
  std::size_t begin_ = 0;  // unread bytes are [begin_, end_)
  std::size_t end_ = 0;
  std::uint64_t offset_ = 0;
  bool at_end_ = false;
  Status status_;
};

}  // namespace submapd::tools
