// The raw log of a run: raw-0000.lcmlog, raw-0001.lcmlog, ..., LCM event logs that lcm-logplayer and replay read.
//
// Events are written one by one, so that a killed program loses none; sync() is what a power cut cannot take. A file
// that has reached its size is synced and the next begins. One thread; blocks on the disk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "slam/base/status.hpp"

namespace submapd {

class RawLog {
 public:
  // Files appear in `folder`, which must exist, with the first event; the first has this number.
  RawLog(std::filesystem::path folder, std::size_t file_bytes_limit, int first_file = 0);
  RawLog(const RawLog&) = delete;
  RawLog& operator=(const RawLog&) = delete;
  ~RawLog();

  // Appends one event. After an error the file ends with the last whole event, and the next call tries again.
  Status write(std::string_view channel, std::int64_t utime_us, std::span<const std::byte> data);
  // What was written is on the disk. Nothing to do if nothing was.
  Status sync();

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }  // of all files

 private:
  Status begin_file();
  Status end_file();
  [[nodiscard]] Status failed(std::string_view step) const;

  const std::filesystem::path folder_;
  const std::size_t file_bytes_limit_;
  std::filesystem::path path_;
  int fd_ = -1;
  int next_file_;
  std::size_t file_bytes_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t events_ = 0;  // of this file
  bool dirty_ = false;
  std::vector<std::byte> event_;
};

}  // namespace submapd
