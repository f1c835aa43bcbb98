// How the slam library gets its parallel work done: whoever owns threads passes a pool in.
//
// Work is split by index, never by time, and tasks share nothing they write: results do not depend on the pool.
#pragma once

#include <functional>

namespace submapd {

class WorkerPool {
 public:
  WorkerPool() = default;
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;
  virtual ~WorkerPool() = default;

  // Calls task(i) for every i in [0, count), each once, and returns when all are done. Not re-entrant.
  virtual void run(int count, const std::function<void(int)>& task) = 0;
};

// Everything on the caller's thread.
class SerialPool final : public WorkerPool {
 public:
  void run(int count, const std::function<void(int)>& task) override {
    for (int i = 0; i < count; ++i) task(i);
  }
};

}  // namespace submapd
