// LD_PRELOAD: the disk is full for a while. Of the calls that write files below DISK_FULL_FOLDER or give them their
// names, those from number DISK_FULL_FROM on fail with ENOSPC, DISK_FULL_FOR of them; then there is room again.
#include <dlfcn.h>
#include <sys/types.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

namespace {

std::atomic<long> g_calls{0};

bool is_ours(std::string_view path) {
  const char* const folder = std::getenv("DISK_FULL_FOLDER");
  return folder != nullptr && path.starts_with(folder);
}

bool is_ours(int fd) {
  std::array<char, 4096> path{};
  const ssize_t size = ::readlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), path.data(), path.size());
  return size > 0 && is_ours(std::string_view(path.data(), static_cast<std::size_t>(size)));
}

bool refuses() {
  const char* const from = std::getenv("DISK_FULL_FROM");
  const char* const count = std::getenv("DISK_FULL_FOR");
  if (from == nullptr || count == nullptr) return false;
  const long call = g_calls.fetch_add(1);
  if (call < std::atol(from) || call >= std::atol(from) + std::atol(count)) return false;
  errno = ENOSPC;
  return true;
}

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

ssize_t write(int fd, const void* data, std::size_t size) {
  static auto* const real = next<ssize_t(int, const void*, std::size_t)>("write");
  return is_ours(fd) && refuses() ? -1 : real(fd, data, size);
}

ssize_t pwrite(int fd, const void* data, std::size_t size, off_t offset) {
  static auto* const real = next<ssize_t(int, const void*, std::size_t, off_t)>("pwrite");
  return is_ours(fd) && refuses() ? -1 : real(fd, data, size, offset);
}

int fsync(int fd) {
  static auto* const real = next<int(int)>("fsync");
  return is_ours(fd) && refuses() ? -1 : real(fd);
}

int rename(const char* from, const char* to) noexcept {
  static auto* const real = next<int(const char*, const char*)>("rename");
  return is_ours(std::string_view(to)) && refuses() ? -1 : real(from, to);
}
}
