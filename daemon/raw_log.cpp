#include "daemon/raw_log.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "slam/base/atomic_file.hpp"

namespace submapd {
namespace {

constexpr std::uint32_t kSync = 0xEDA1DA01;  // LCM's documentation, "Log File format"

template <typename T>
void put_big_endian(std::vector<std::byte>& bytes, T value) {
  for (std::size_t i = sizeof(T); i-- > 0;) bytes.push_back(static_cast<std::byte>((value >> (8 * i)) & 0xFF));
}

}  // namespace

RawLog::RawLog(std::filesystem::path folder, std::size_t file_bytes_limit, int first_file)
    : folder_(std::move(folder)), file_bytes_limit_(file_bytes_limit), next_file_(first_file) {}

RawLog::~RawLog() {
  (void)end_file();
}

Status RawLog::failed(std::string_view step) const {
  return {StatusCode::kIo, fmt::format("{}: cannot {}: {}", path_.string(), step, std::strerror(errno))};
}

Status RawLog::begin_file() {
  path_ = folder_ / fmt::format("raw-{:04}.lcmlog", next_file_);
  fd_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0640);
  if (fd_ < 0) return failed("make");
  ++next_file_;
  file_bytes_ = 0;
  events_ = 0;
  return sync_folder(folder_);
}

Status RawLog::end_file() {
  if (fd_ < 0) return {};
  Status status = sync();
  ::close(std::exchange(fd_, -1));
  return status;
}

Status RawLog::write(std::string_view channel, std::int64_t utime_us, std::span<const std::byte> data) {
  if (fd_ >= 0 && file_bytes_ >= file_bytes_limit_) {
    if (Status status = end_file(); !status.ok()) return status;
  }
  if (fd_ < 0) {
    if (Status status = begin_file(); !status.ok()) return status;
  }
  event_.clear();
  put_big_endian(event_, kSync);
  put_big_endian(event_, events_);
  put_big_endian(event_, static_cast<std::uint64_t>(utime_us));
  put_big_endian(event_, static_cast<std::uint32_t>(channel.size()));
  put_big_endian(event_, static_cast<std::uint32_t>(data.size()));
  const auto name = std::as_bytes(std::span(channel));
  event_.insert(event_.end(), name.begin(), name.end());
  event_.insert(event_.end(), data.begin(), data.end());
  const ssize_t wrote = ::write(fd_, event_.data(), event_.size());
  if (wrote != static_cast<ssize_t>(event_.size())) {
    if (wrote >= 0) errno = ENOSPC;
    Status status = failed("write");
    if (wrote > 0 && ::ftruncate(fd_, static_cast<off_t>(file_bytes_)) != 0) (void)end_file();  // readers resynchronise
    return status;
  }
  file_bytes_ += event_.size();
  bytes_ += event_.size();
  ++events_;
  dirty_ = true;
  return {};
}

Status RawLog::sync() {
  if (!std::exchange(dirty_, false)) return {};
  return ::fdatasync(fd_) == 0 ? Status() : failed("sync");
}

}  // namespace submapd
