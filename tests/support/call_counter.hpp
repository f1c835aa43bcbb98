// Counts allocations and locks of the calling thread while `armed` is set. Replaces malloc: include it in one file of a
// test's executable, and link ${CMAKE_DL_LIBS}.
#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <cstddef>
#include <cstdlib>

// A sanitizer has its own malloc, which must not be replaced. g++ and clang tell of it in different ways.
#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SUBMAPD_SANITIZED 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || defined(SUBMAPD_SANITIZED)
#define SUBMAPD_COUNTS_CALLS 0
#else
#define SUBMAPD_COUNTS_CALLS 1
#endif

namespace submapd::test {
inline thread_local bool armed = false;
inline thread_local std::size_t allocations = 0;
inline thread_local std::size_t locks = 0;
}  // namespace submapd::test

#if SUBMAPD_COUNTS_CALLS
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);

void* malloc(std::size_t size) {
  submapd::test::allocations += submapd::test::armed ? 1U : 0U;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  submapd::test::allocations += submapd::test::armed ? 1U : 0U;
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  submapd::test::allocations += submapd::test::armed ? 1U : 0U;
  return __libc_realloc(old, size);
}
int pthread_mutex_lock(pthread_mutex_t* mutex) {
  using Lock = int (*)(pthread_mutex_t*);
  static const Lock kReal = reinterpret_cast<Lock>(dlsym(RTLD_NEXT, "pthread_mutex_lock"));
  submapd::test::locks += submapd::test::armed ? 1U : 0U;
  return kReal(mutex);
}
}
#endif

namespace submapd::test {

inline void expect_the_counters_count() {
#if SUBMAPD_COUNTS_CALLS
  pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
  allocations = 0;
  locks = 0;
  armed = true;
  void* const block = std::malloc(100);
  pthread_mutex_lock(&mutex);
  armed = false;
  pthread_mutex_unlock(&mutex);
  std::free(block);
  EXPECT_EQ(allocations, 1U);
  EXPECT_EQ(locks, 1U);
#endif
}

}  // namespace submapd::test
