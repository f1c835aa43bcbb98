// A mutex whose use clang checks: which member it guards is written at the member (GUARDED_BY) and checked by
// -Wthread-safety. With g++ the annotations are empty.
#pragma once

#include <mutex>

#if defined(__clang__)
#define SUBMAPD_THREAD_ANNOTATION(x) __attribute__((x))
#else
#define SUBMAPD_THREAD_ANNOTATION(x)
#endif
#define GUARDED_BY(mutex) SUBMAPD_THREAD_ANNOTATION(guarded_by(mutex))
#define REQUIRES_LOCK(mutex) SUBMAPD_THREAD_ANNOTATION(requires_capability(mutex))

namespace submapd {

class SUBMAPD_THREAD_ANNOTATION(capability("mutex")) Mutex {
 public:
  void lock() SUBMAPD_THREAD_ANNOTATION(acquire_capability()) { mutex_.lock(); }
  void unlock() SUBMAPD_THREAD_ANNOTATION(release_capability()) { mutex_.unlock(); }

 private:
  std::mutex mutex_;
};

// Holds a Mutex for a scope. Wait on a std::condition_variable_any with the Mutex itself, in a loop over the condition.
class SUBMAPD_THREAD_ANNOTATION(scoped_lockable) MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) SUBMAPD_THREAD_ANNOTATION(acquire_capability(mutex)) : mutex_(mutex) {
    mutex_.lock();
  }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;
  ~MutexLock() SUBMAPD_THREAD_ANNOTATION(release_capability()) { mutex_.unlock(); }

 private:
  Mutex& mutex_;
};

}  // namespace submapd
