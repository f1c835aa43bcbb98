#include "daemon/allocator.hpp"

#include <malloc.h>

namespace submapd {

void set_up_allocator() {
  // Where malloc is not glibc's (sanitizers) these are refused, and nothing depends on them.
  (void)::mallopt(M_ARENA_MAX, 1);
  (void)::mallopt(M_MMAP_THRESHOLD, 128 * 1024);
}

}  // namespace submapd
