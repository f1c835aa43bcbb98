#include "slam/output/internal/text_file.hpp"

#include <string_view>

namespace submapd::internal {

Status TextFile::commit() {
  if (Status status = flush(); !status.ok()) return status;
  return file_.commit();
}

Status TextFile::append(fmt::string_view format, fmt::format_args args) {
  fmt::vformat_to(fmt::appender(buffer_), format, args);
  return buffer_.size() < kPiece_bytes ? Status() : flush();
}

Status TextFile::flush() {
  Status status = file_.write(std::string_view(buffer_.data(), buffer_.size()));
  buffer_.clear();
  return status;
}

}  // namespace submapd::internal
