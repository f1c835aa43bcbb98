#include "slam/output/pose_spool.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

namespace submapd {
namespace {

constexpr std::uint64_t kRecordsAtOnce = 256;

off_t offset_of(std::uint64_t record) {
  return static_cast<off_t>(record * sizeof(SpooledPose));
}

}  // namespace

Expected<std::unique_ptr<PoseSpool>> PoseSpool::create(const std::filesystem::path& folder) {
  std::string name = (folder / ".poses.XXXXXX").string();
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) {
    return failure(StatusCode::kIo,
                   fmt::format("cannot make a temporary file in {}: {}", folder.string(), std::strerror(errno)));
  }
  ::unlink(name.c_str());
  return std::unique_ptr<PoseSpool>(new PoseSpool(fd));
}

PoseSpool::~PoseSpool() {
  ::close(fd_);
}

Status PoseSpool::add(const SpooledPose& pose) {
  const std::uint64_t record = size_.load(std::memory_order_relaxed);
  const ssize_t wrote = ::pwrite(fd_, &pose, sizeof pose, offset_of(record));
  if (wrote != static_cast<ssize_t>(sizeof pose)) {
    return {StatusCode::kIo,
            fmt::format("cannot write the poses of scans: {}", std::strerror(wrote < 0 ? errno : ENOSPC))};
  }
  size_.store(record + 1, std::memory_order_release);
  return {};
}

Status PoseSpool::for_each(std::uint64_t count, const std::function<Status(const SpooledPose&)>& visit) const {
  std::vector<SpooledPose> records(std::min(count, kRecordsAtOnce));
  for (std::uint64_t first = 0; first < count; first += records.size()) {
    const std::uint64_t some = std::min<std::uint64_t>(records.size(), count - first);
    const std::size_t bytes = some * sizeof(SpooledPose);
    if (::pread(fd_, records.data(), bytes, offset_of(first)) != static_cast<ssize_t>(bytes)) {
      return {StatusCode::kIo, "cannot read the poses of scans back"};
    }
    for (std::uint64_t i = 0; i < some; ++i) {
      if (Status status = visit(records[i]); !status.ok()) return status;
    }
  }
  return {};
}

}  // namespace submapd
