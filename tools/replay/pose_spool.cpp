#include "tools/replay/pose_spool.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace submapd::tools {

Expected<std::unique_ptr<PoseSpool>> PoseSpool::create(const std::filesystem::path& folder) {
  std::string name = (folder / ".poses.XXXXXX").string();
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) {
    return failure(StatusCode::kIo,
                   fmt::format("cannot make a temporary file in {}: {}", folder.string(), std::strerror(errno)));
  }
  ::unlink(name.c_str());
  std::FILE* file = ::fdopen(fd, "w+b");
  if (file == nullptr) {
    ::close(fd);
    return failure(StatusCode::kIo,
                   fmt::format("cannot use a temporary file in {}: {}", folder.string(), std::strerror(errno)));
  }
  return std::unique_ptr<PoseSpool>(new PoseSpool(file));
}

Status PoseSpool::add(const SpooledPose& pose) {
  if (std::fwrite(&pose, sizeof pose, 1, file_.get()) != 1) {
    return {StatusCode::kIo, fmt::format("cannot write the poses of scans: {}", std::strerror(errno))};
  }
  ++size_;
  return {};
}

Status PoseSpool::for_each(const std::function<Status(const SpooledPose&)>& visit) {
  std::rewind(file_.get());
  SpooledPose pose;
  for (std::uint64_t i = 0; i < size_; ++i) {
    if (std::fread(&pose, sizeof pose, 1, file_.get()) != 1) {
      return {StatusCode::kIo, "cannot read the poses of scans back"};
    }
    if (Status status = visit(pose); !status.ok()) return status;
  }
  std::fseek(file_.get(), 0, SEEK_END);
  return {};
}

}  // namespace submapd::tools
