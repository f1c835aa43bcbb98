// What both fuzz targets of the log readers do: open the bytes as a log, read all, check what the reader promises.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <span>
#include <utility>

#include "tools/log/log_reader.hpp"

namespace submapd::tools::test {

inline void require(bool holds) {
  if (!holds) std::abort();
}

inline void read_log(std::span<const std::byte> bytes, ScanDecoder decoder) {
  auto reader = open_log(open_memory(bytes), "fuzz", std::move(decoder));
  if (!reader) {
    require(!reader.error().message().empty());
    return;
  }
  std::uint64_t scans = 0;
  for (auto scan = (*reader)->next();; scan = (*reader)->next()) {
    require(scan.has_value());  // memory has no I/O errors
    if (!scan->has_value()) break;
    require((*scan)->ranges_mm.size() <= 10000);
    require((*reader)->progress() >= 0.0 && (*reader)->progress() <= 1.0);
    ++scans;
  }
  const LogSummary& summary = (*reader)->summary();
  require(scans > 0 && summary.scans == scans);
  require(summary.problems.size() <= LogSummary::kMaxProblems);
  require((summary.skipped_records > 0 || summary.unreadable_tail) == !summary.problems.empty());
}

}  // namespace submapd::tools::test
