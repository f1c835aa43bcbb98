// Cuts a log into chunks by time, each with a look at the beginning of the next one.
//
// Chunk 0 begins with the log's first scan; a scan stamped `length_s` or more after the first one of its chunk begins
// the next. A chunk's seam are the first scans of the next one, as long as `seam_s`: they are mapped in both. What
// would be no longer than a seam is no chunk, but the end of the one before. All of that is told by the log alone.
//
// Goes forward only. One thread; in memory is a seam and one scan more.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "slam/base/status.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::tools {

struct ChunkOptions {
  double length_s = 120.0;
  double seam_s = 6.0;             // a chunk's sub-map is 20 m long, half of it at 3 m/s takes 3 s
  std::size_t seam_scans = 2'000;  // at most: stamps of a damaged log may stand still
};

class ChunkReader {
 public:
  ChunkReader(std::unique_ptr<LogReader> log, const ChunkOptions& options) : log_(std::move(log)), options_(options) {}

  // To the beginning of a chunk at or behind the present one. False: the log ends before. Errors: kIo.
  Expected<bool> enter(std::uint64_t chunk);
  // The chunk's next scan; nothing at its end.
  Expected<std::optional<Scan>> next();
  // At a chunk's end: its seam, empty if it is the last.
  [[nodiscard]] const std::deque<Scan>& ahead() const { return ahead_; }
  [[nodiscard]] std::size_t seam_scans() const { return seam_; }

  [[nodiscard]] const LogReader& log() const { return *log_; }

 private:
  // Reads until `count` scans are ahead; false: the log has not so many.
  Expected<bool> look_ahead(std::size_t count);

  const std::unique_ptr<LogReader> log_;
  const ChunkOptions options_;
  std::deque<Scan> ahead_;
  std::size_t seam_ = 0;  // of ahead_, once the chunk is at its end
  bool at_end_ = false;
  bool last_ = false;  // no chunk follows
  std::uint64_t chunk_ = 0;
  std::optional<std::int64_t> begun_us_;
};

}  // namespace submapd::tools
