#include "tools/log/input_buffer.hpp"

#include <algorithm>
#include <cstring>

namespace submapd::tools {
namespace {
constexpr std::size_t kChunk = std::size_t{64} << 10;  // least room to read into
}

std::span<const std::byte> InputBuffer::peek(std::size_t count) {
  while (end_ - begin_ < count && !at_end_) {
    if (bytes_.size() - end_ < kChunk) {
      // Doubling, and moving only when half of the buffer is spent, keeps the copying linear in the input.
      const std::size_t unread = end_ - begin_;
      if (begin_ <= bytes_.size() / 2) {
        bytes_.resize(std::min(std::max(2 * bytes_.size(), 2 * kChunk), 2 * kMaxWindow + kChunk));
      }
      std::memmove(bytes_.data(), bytes_.data() + begin_, unread);
      begin_ = 0;
      end_ = unread;
    }
    const auto got = source_->read(std::span(bytes_).subspan(end_));
    if (!got) status_ = got.error();
    at_end_ = !got || *got == 0;
    end_ += got.value_or(0);
  }
  return std::span(bytes_).subspan(begin_, end_ - begin_);
}

}  // namespace submapd::tools
