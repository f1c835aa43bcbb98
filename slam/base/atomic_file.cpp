#include "slam/base/atomic_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <system_error>
#include <utility>

namespace submapd {
namespace {

std::atomic<std::uint64_t> g_temporaries{0};  // makes two temporaries of one process differ

class FileDescriptor {
 public:
  explicit FileDescriptor(const std::filesystem::path& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }

 private:
  int fd_;
};

}  // namespace

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  const std::string name = fmt::format(".{}.{}.{}.tmp", path_.filename().string(), ::getpid(), g_temporaries++);
  const std::filesystem::path temporary = path_.parent_path() / name;
  fd_ = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) {
    (void)fail("cannot create a temporary file");
    return;
  }
  temporary_ = temporary;
}

AtomicFile::~AtomicFile() {
  remove_temporary();
}

Status AtomicFile::write(std::span<const std::byte> bytes) {
  if (status_.ok() && fd_ < 0) status_ = Status(StatusCode::kInternal, path_.string() + ": write after commit");
  while (status_.ok() && !bytes.empty()) {
    const ssize_t written = ::write(fd_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return fail("cannot write");
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return status_;
}

Status AtomicFile::commit() {
  if (status_.ok() && fd_ < 0) status_ = Status(StatusCode::kInternal, path_.string() + ": committed twice");
  if (!status_.ok()) return status_;
  if (::fsync(fd_) != 0) return fail("cannot sync");
  if (::close(std::exchange(fd_, -1)) != 0) return fail("cannot close");
  if (::rename(temporary_.c_str(), path_.c_str()) != 0) return fail("cannot rename the temporary file");
  temporary_.clear();
  status_ = sync_folder(path_.has_parent_path() ? path_.parent_path() : std::filesystem::path("."));
  return status_;
}

Status AtomicFile::fail(std::string_view step) {
  const int error = errno;
  status_ =
      Status(StatusCode::kIo, fmt::format("{}: {}: {}", path_.string(), step, std::generic_category().message(error)));
  remove_temporary();
  return status_;
}

void AtomicFile::remove_temporary() {
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  temporary_.clear();
}

Status sync_folder(const std::filesystem::path& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool synced = fd >= 0 && ::fsync(fd) == 0;
  const int error = errno;
  if (fd >= 0) ::close(fd);
  if (synced) return {};
  return {StatusCode::kIo,
          fmt::format("{}: cannot sync the folder: {}", folder.string(), std::generic_category().message(error))};
}

Status atomic_write_file(const std::filesystem::path& path, std::span<const std::byte> bytes) {
  AtomicFile file(path);
  if (Status status = file.write(bytes); !status.ok()) return status;
  return file.commit();
}

Expected<std::vector<std::byte>> read_file(const std::filesystem::path& path, std::size_t most) {
  const auto refused = [&path](std::string_view step) {
    const int error = errno;
    return failure(error == ENOENT ? StatusCode::kNotFound : StatusCode::kIo,
                   fmt::format("{}: {}: {}", path.string(), step, std::generic_category().message(error)));
  };
  const FileDescriptor file(path);
  if (file.get() < 0) return refused("cannot open");
  struct stat info {};
  if (::fstat(file.get(), &info) != 0) return refused("cannot stat");
  if (!S_ISREG(info.st_mode)) return failure(StatusCode::kIo, path.string() + ": not a regular file");
  if (info.st_size > static_cast<off_t>(most)) {
    return failure(StatusCode::kCorrupt,
                   fmt::format("{}: {} bytes, larger than any such file", path.string(), info.st_size));
  }
  std::vector<std::byte> bytes(static_cast<std::size_t>(info.st_size));
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t got = ::read(file.get(), bytes.data() + done, bytes.size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return refused("cannot read");
    if (got == 0) break;  // shorter than it said: who decodes it will tell
    done += static_cast<std::size_t>(got);
  }
  bytes.resize(done);
  return bytes;
}

}  // namespace submapd
