#include "tools/log/carmen_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace submapd::tools {

Expected<std::optional<Scan>> CarmenReader::next() {
  Scan scan;
  while (!finished_) {
    const auto line = look_at_line();
    if (!line) {
      if (input_.status().code() == StatusCode::kIo) return failure(input_.status());
      finish();
      break;
    }
    ++line_number_;
    if (line->is_too_long) {
      skip_long_line();
    } else if (line->is_last && !input_.status().ok()) {
      // Even if it reads well: its last number may lack digits.
      input_.consume(line->size_bytes);
      skip("is cut short", line->size_bytes);
    } else {
      const auto record = parser_.parse(line->text, scan);
      const std::string problem = record ? std::string() : record.error().message();
      input_.consume(line->size_bytes);
      if (!record) {
        skip(problem, line->size_bytes);
      } else if (*record == CarmenRecord::kScan) {
        scan.index = summary_.scans++;
        if (scan.index > 0 && scan.stamp_us < last_stamp_us_) ++summary_.backward_stamps;
        last_stamp_us_ = scan.stamp_us;
        return scan;
      } else if (*record == CarmenRecord::kOdometry) {
        ++summary_.odometry_records;
      } else if (*record == CarmenRecord::kOther) {
        ++summary_.other_records;
      }
    }
    if (summary_.scans + summary_.odometry_records == 0 && input_.offset() > kGiveUp_bytes) finish();
  }
  return std::nullopt;
}

std::optional<CarmenReader::Line> CarmenReader::look_at_line() {
  std::size_t searched = 0;
  for (;;) {
    const auto window = input_.peek(searched + 1);
    const char* const text = reinterpret_cast<const char*>(window.data());
    if (window.size() == searched) {  // the input's end
      if (window.empty()) return std::nullopt;
      return Line{.text = {text, searched}, .size_bytes = searched, .is_last = true};
    }
    const std::size_t limit = std::min(window.size(), kMaxLine_bytes);
    const auto* const feed = static_cast<const char*>(std::memchr(text + searched, '\n', limit - searched));
    if (feed != nullptr) {
      const auto size = static_cast<std::size_t>(feed - text);
      return Line{.text = {text, size}, .size_bytes = size + 1};
    }
    if (limit == kMaxLine_bytes) return Line{.text = {text, limit}, .size_bytes = limit, .is_too_long = true};
    searched = limit;
  }
}

void CarmenReader::skip_long_line() {
  const std::uint64_t start = input_.offset();
  bool ended = false;
  while (!ended && input_.offset() - start <= kGiveUp_bytes) {
    const auto window = input_.peek(1);
    const auto feed = std::find(window.begin(), window.end(), std::byte{'\n'});
    ended = window.empty() || feed != window.end();
    input_.consume(static_cast<std::size_t>(feed - window.begin()) + (feed != window.end() ? 1 : 0));
  }
  skip(fmt::format("is longer than {} bytes", kMaxLine_bytes), input_.offset() - start);
}

void CarmenReader::skip(const std::string& what, std::uint64_t size_bytes) {
  ++summary_.skipped_records;
  summary_.skipped_bytes += size_bytes;
  summary_.add_problem(fmt::format("line {}: {}", line_number_, what));
}

void CarmenReader::finish() {
  finished_ = true;
  if (input_.status().ok()) return;
  summary_.unreadable_tail = true;
  summary_.add_problem(fmt::format("after line {}: {}", line_number_, input_.status().message()));
}

}  // namespace submapd::tools
