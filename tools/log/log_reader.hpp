// Reads the scans of a recorded log, one after the other: CARMEN text or LCM events, plain or packed with gzip or xz.
//
// Which it is is told by the content, never by the name. Damaged records are skipped and counted, the reader goes on.
// Memory is bounded, the file may be of any length. Not thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/scan/scan.hpp"
#include "tools/log/byte_source.hpp"

namespace submapd::tools {

// What has been read so far. A reader looks one scan ahead when it is opened.
struct LogSummary {
  std::uint64_t scans = 0;
  std::uint64_t odometry_records = 0;
  std::uint64_t other_records = 0;    // well formed but neither: unknown keywords, other channels
  std::uint64_t skipped_records = 0;  // damaged lines or events
  std::uint64_t skipped_bytes = 0;    // in them and between them
  std::uint64_t backward_stamps = 0;  // scans stamped before the scan before them; delivered all the same
  std::uint64_t tail_bytes = 0;       // of skipped_bytes: one skipped record that reaches the end of the log
  bool unreadable_tail = false;       // the input is cut short: what came before the cut was read
  std::vector<std::string> problems;  // the first kMaxProblems, each with its line or byte offset

  static constexpr std::size_t kMaxProblems = 8;
  void add_problem(std::string text) {
    if (problems.size() < kMaxProblems) problems.push_back(std::move(text));
  }
};

class LogReader {
 public:
  LogReader() = default;
  LogReader(const LogReader&) = delete;
  LogReader& operator=(const LogReader&) = delete;
  virtual ~LogReader() = default;

  // The next scan, or nothing at the end of the log. kIo: the operating system refused to read on.
  [[nodiscard]] virtual Expected<std::optional<Scan>> next() = 0;

  [[nodiscard]] virtual const LogSummary& summary() const = 0;

  // Share of the file that is read, 0 to 1, by its packed bytes if it is packed; 0 for a pipe until its end.
  [[nodiscard]] virtual double progress() const = 0;
};

// Turns one LCM event into a scan; nothing if the channel does not carry scans. An error counts as a damaged record.
// Scan::index is delivered as the decoder sets it, because a gap in it is a lost scan.
using ScanDecoder =
    std::function<Expected<std::optional<Scan>>(std::string_view channel, std::span<const std::byte> data)>;

// Opens a log and reads up to its first scan; a run's folder and its raw-0000.lcmlog mean all raw files of the run.
// kNotFound, kIo, or kInvalidArgument if the file holds no scan; the
// message has the path and what to do.
[[nodiscard]] Expected<std::unique_ptr<LogReader>> open_log(const std::string& path, ScanDecoder decoder);

// The same for any source of bytes; `name` stands for the path in messages.
[[nodiscard]] Expected<std::unique_ptr<LogReader>> open_log(std::unique_ptr<ByteSource> source, const std::string& name,
                                                            ScanDecoder decoder);

}  // namespace submapd::tools
