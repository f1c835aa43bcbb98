#include "daemon/realtime.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace submapd {
Status lock_memory() {
  rlimit limit{};
  // With a finite limit MCL_FUTURE would make a later allocation fail instead of this call.
  const bool unlimited = ::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
  if (!unlimited && ::geteuid() != 0) {  // root's is not limited
    return {StatusCode::kUnavailable,
            fmt::format("memory is not locked: the limit is {} kB; LimitMEMLOCK=infinity in the unit lifts it",
                        limit.rlim_cur / 1024)};
  }
  if (::mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0) {
    return {StatusCode::kUnavailable, fmt::format("memory is not locked: {}", std::strerror(errno))};
  }
  return {};
}

Status take_fifo_priority(int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return {};
  return {StatusCode::kUnavailable, fmt::format("no real-time priority {}: {}; LimitRTPRIO={} in the unit allows it",
                                                priority, std::strerror(error), kUsbPriority)};
}

void give_up_fifo_priority() {
  const sched_param parameters{};
  ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &parameters);
}

void name_thread(const char* name) {
  ::pthread_setname_np(::pthread_self(), name);
}

}  // namespace submapd
