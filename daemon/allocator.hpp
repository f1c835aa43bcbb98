// How malloc treats what lives for long and what only lives for a solve.
#pragma once

#include <cstddef>

namespace submapd {

// One heap for all threads, and blocks from 128 kB on mapped and given back for themselves: memory that one thread has
// freed serves the next, and the largest use of a run does not stay with the process. Call first thing in main().
void set_up_allocator();

// Of heap beside the budgets: a match of two sub-maps, a live solve, messages.
inline constexpr std::size_t kWorkHeap_bytes = 16U << 20;

// Takes and touches so much free heap now, for good: what fills a budget in the course of hours is resident from the
// start, and a machine too small for it shows that at once. For a program that runs for long, once its pools are made
// (which would use it up); where so much is free and touched already it takes nothing.
void reserve_heap(std::size_t bytes);

}  // namespace submapd
