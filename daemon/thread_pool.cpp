#include "daemon/thread_pool.hpp"

namespace submapd {

ThreadPool::ThreadPool(int threads) {
  for (int i = 1; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

ThreadPool::~ThreadPool() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ThreadPool::take_indices() {
  for (int i = next_.fetch_add(1); i < count_; i = next_.fetch_add(1)) (*task_)(i);
}

void ThreadPool::run(int count, const std::function<void(int)>& task) {
  if (threads_.empty() || count < 2) {
    for (int i = 0; i < count; ++i) task(i);
    return;
  }
  {
    const MutexLock lock(mutex_);
    task_ = &task;
    count_ = count;
    next_ = 0;
    busy_ = static_cast<int>(threads_.size());
    ++round_;
  }
  wake_.notify_all();
  take_indices();
  MutexLock lock(mutex_);
  while (busy_ != 0) done_.wait(mutex_);
}

void ThreadPool::work() {
  std::uint64_t seen = 0;
  for (;;) {
    {
      const MutexLock lock(mutex_);
      while (!stop_ && round_ == seen) wake_.wait(mutex_);
      if (stop_) return;
      seen = round_;
    }
    take_indices();
    const MutexLock lock(mutex_);
    if (--busy_ == 0) done_.notify_one();
  }
}

}  // namespace submapd
