#include "tools/replay/chunk_reader.hpp"

#include <utility>

namespace submapd::tools {
namespace {

// Stamps of a damaged log may be anything.
double seconds_between(std::int64_t from_us, std::int64_t to_us) {
  return (static_cast<double>(to_us) - static_cast<double>(from_us)) * 1e-6;
}

}  // namespace

Expected<bool> ChunkReader::look_ahead(std::size_t count) {
  while (ahead_.size() < count) {
    Expected<std::optional<Scan>> scan = log_->next();
    if (!scan) return failure(scan.error());
    if (!scan->has_value()) return false;
    ahead_.push_back(std::move(**scan));
  }
  return true;
}

Expected<std::optional<Scan>> ChunkReader::next() {
  if (at_end_) return std::optional<Scan>();
  const Expected<bool> any = look_ahead(1);
  if (!any) return failure(any.error());
  if (!*any) {
    at_end_ = last_ = true;
    return std::optional<Scan>();
  }
  const std::int64_t stamp_us = ahead_.front().stamp_us;
  if (!begun_us_) begun_us_ = stamp_us;
  if (!last_ && seconds_between(*begun_us_, stamp_us) >= options_.length_s) {
    std::size_t seam = 0;
    while (seam < options_.seam_scans) {
      const Expected<bool> more = look_ahead(seam + 1);
      if (!more) return failure(more.error());
      last_ = !*more;
      if (last_ || seconds_between(stamp_us, ahead_[seam].stamp_us) >= options_.seam_s) break;
      ++seam;
    }
    if (!last_) {
      seam_ = seam;
      at_end_ = true;
      return std::optional<Scan>();
    }
  }
  std::optional<Scan> scan = std::move(ahead_.front());
  ahead_.pop_front();
  return scan;
}

Expected<bool> ChunkReader::enter(std::uint64_t chunk) {
  while (chunk_ < chunk) {
    for (;;) {
      const Expected<std::optional<Scan>> passed = next();
      if (!passed) return failure(passed.error());
      if (!passed->has_value()) break;
    }
    if (last_) return false;
    ++chunk_;
    begun_us_.reset();
    at_end_ = false;
    seam_ = 0;
  }
  return true;
}

}  // namespace submapd::tools
