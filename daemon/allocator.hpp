// How malloc treats what lives for long and what only lives for a solve.
#pragma once

#include <cstddef>

namespace submapd {

// One heap for all threads, and blocks from 128 kB on mapped and given back for themselves: memory that one thread has
// freed serves the next, and the largest use of a run does not stay with the process. Call first thing in main().
void set_up_allocator();

// Of heap beside the budgets: a match of two sub-maps, messages, and the live solver, which takes up to four times what
// the graph takes. Not more than the 40 MB beside the budgets leave after code and stacks.
[[nodiscard]] constexpr std::size_t work_heap_bytes(std::size_t graph_bytes) {
  constexpr std::size_t kMatch_bytes = 20U << 20;
  constexpr std::size_t kMostSolver_bytes = 24U << 20;
  constexpr std::size_t kSolverPart = 4;
  return kMatch_bytes + (graph_bytes < kMostSolver_bytes / kSolverPart ? kSolverPart * graph_bytes : kMostSolver_bytes);
}

// Takes and touches so much free heap now, for good: what fills a budget in the course of hours is resident from the
// start, and a machine too small for it shows that at once. For a program that runs for long, once its pools are made
// (which would use it up); where so much is free and touched already it takes nothing.
void reserve_heap(std::size_t bytes);

}  // namespace submapd
