#include "tools/log/byte_source.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <system_error>

namespace submapd::tools {
namespace {

std::string reason(int error) {
  return std::generic_category().message(error);
}

class FileSource final : public ByteSource {
 public:
  // Takes over the open descriptor. size_bytes 0: not known (a pipe).
  FileSource(int descriptor, std::string path, std::uint64_t size_bytes)
      : descriptor_(descriptor), path_(std::move(path)), size_bytes_(size_bytes) {}
  ~FileSource() override { ::close(descriptor_); }

  Expected<std::size_t> read(std::span<std::byte> into) override {
    ssize_t got = -1;
    do {
      got = ::read(descriptor_, into.data(), into.size());
    } while (got < 0 && errno == EINTR);
    if (got < 0) {
      return failure(StatusCode::kIo, fmt::format("{}: cannot read on after byte {}: {}", path_, done_, reason(errno)));
    }
    at_end_ = got == 0;
    done_ += static_cast<std::uint64_t>(got);
    return static_cast<std::size_t>(got);
  }

  double progress(std::size_t unused_bytes) const override {
    if (size_bytes_ == 0) return at_end_ && unused_bytes == 0 ? 1.0 : 0.0;
    return std::min(1.0, static_cast<double>(done_ - unused_bytes) / static_cast<double>(size_bytes_));
  }

 private:
  int descriptor_;
  std::string path_;
  std::uint64_t size_bytes_;
  std::uint64_t done_ = 0;
  bool at_end_ = false;
};

class MemorySource final : public ByteSource {
 public:
  explicit MemorySource(std::span<const std::byte> bytes) : bytes_(bytes) {}

  Expected<std::size_t> read(std::span<std::byte> into) override {
    const std::size_t count = std::min(into.size(), bytes_.size() - done_);
    if (count > 0) std::memcpy(into.data(), bytes_.data() + done_, count);
    done_ += count;
    return count;
  }

  double progress(std::size_t unused_bytes) const override {
    return bytes_.empty() ? 1.0 : static_cast<double>(done_ - unused_bytes) / static_cast<double>(bytes_.size());
  }

 private:
  std::span<const std::byte> bytes_;
  std::size_t done_ = 0;
};

}  // namespace

Expected<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENOTDIR) {
      return failure(StatusCode::kNotFound, fmt::format("{}: there is no such file; check the path", path));
    }
    return failure(StatusCode::kIo, fmt::format("{}: cannot open: {}", path, reason(error)));
  }
  struct stat info {};
  const bool known = ::fstat(descriptor, &info) == 0;
  auto source = std::make_unique<FileSource>(
      descriptor, path, known && S_ISREG(info.st_mode) ? static_cast<std::uint64_t>(info.st_size) : 0);
  if (known && S_ISDIR(info.st_mode)) {
    return failure(StatusCode::kInvalidArgument, fmt::format("{}: is a folder; give one log file", path));
  }
  return source;
}

std::unique_ptr<ByteSource> open_memory(std::span<const std::byte> bytes) {
  return std::make_unique<MemorySource>(bytes);
}

}  // namespace submapd::tools
