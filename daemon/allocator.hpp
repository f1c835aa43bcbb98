// How malloc treats what lives for long and what only lives for a solve.
#pragma once

namespace submapd {

// One heap for all threads, and blocks from 128 kB on mapped and given back for themselves: memory that one thread has
// freed serves the next, and the largest use of a run does not stay with the process. Call first thing in main().
void set_up_allocator();

}  // namespace submapd
