#include "daemon/allocator.hpp"

#include <malloc.h>
#include <unistd.h>

#include <cstdlib>
#include <limits>

namespace submapd {
namespace {

constexpr int kMappedFrom_bytes = 128 * 1024;
constexpr int kMappings = 65536;  // glibc's own limit

}  // namespace

void set_up_allocator() {
  // Where malloc is not glibc's (sanitizers) these are refused, and nothing depends on them.
  (void)::mallopt(M_ARENA_MAX, 1);
  (void)::mallopt(M_MMAP_THRESHOLD, kMappedFrom_bytes);
}

void reserve_heap(std::size_t bytes) {
  const bool ours = ::mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max()) == 1;  // the heap keeps what it has
  if (!ours || ::mallopt(M_MMAP_MAX, 0) != 1) return;
  if (auto* const block = static_cast<volatile char*>(std::malloc(bytes))) {
    const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
    for (std::size_t i = 0; i < bytes; i += page) block[i] = 1;
    std::free(const_cast<char*>(block));
  }
  (void)::mallopt(M_MMAP_MAX, kMappings);
}

}  // namespace submapd
