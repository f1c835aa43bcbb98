// A fixed set of threads that share out indexed work (slam/base/worker_pool.hpp).
//
// The caller's thread works too. Which thread runs which index is left to chance; the tasks write apart, so results are
// the same for any number of threads.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <thread>
#include <vector>

#include "daemon/mutex.hpp"
#include "slam/base/worker_pool.hpp"

namespace submapd {

class ThreadPool final : public WorkerPool {
 public:
  // `threads` >= 1 counts the caller's; 1 makes no thread at all.
  explicit ThreadPool(int threads);
  ~ThreadPool() override;

  void run(int count, const std::function<void(int)>& task) override;

 private:
  void work();
  void take_indices();

  Mutex mutex_;
  std::condition_variable_any wake_;
  std::condition_variable_any done_;
  std::uint64_t round_ GUARDED_BY(mutex_) = 0;
  int busy_ GUARDED_BY(mutex_) = 0;
  bool stop_ GUARDED_BY(mutex_) = false;
  // Written under the mutex before a round starts, read by the workers of that round.
  const std::function<void(int)>* task_ = nullptr;
  int count_ = 0;
  std::atomic<int> next_{0};
  std::vector<std::thread> threads_;
};

}  // namespace submapd
