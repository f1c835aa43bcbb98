// What the kernel may grant a real-time program: memory that stays, and priorities.
//
// Nothing here is needed to map; where it is refused, a message says which limit helps, once.
#pragma once

#include <string>

#include "slam/base/status.hpp"

namespace submapd {

inline constexpr int kUsbPriority = 60;
inline constexpr int kMapperPriority = 40;

// Keeps every page that is touched from now on in memory. kUnavailable with words if this is not allowed.
[[nodiscard]] Status lock_memory();

// SCHED_FIFO for the calling thread and the threads it will make. kUnavailable with words if this is not allowed.
[[nodiscard]] Status take_fifo_priority(int priority);

// Back to the scheduler of all others.
void give_up_fifo_priority();

// The calling thread's name in ps and gdb; at most 15 characters.
void name_thread(const char* name);

}  // namespace submapd
