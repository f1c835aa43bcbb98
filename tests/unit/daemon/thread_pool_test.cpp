// Each index once, whatever the number of threads and rounds; run under TSan.
#include "daemon/thread_pool.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <set>
#include <thread>
#include <vector>

namespace submapd {
namespace {

TEST(ThreadPoolTest, CallsEachIndexOnceInEveryRound) {
  for (const int threads : {1, 2, 3, 4, 8}) {
    ThreadPool pool(threads);
    for (int round = 0; round < 500; ++round) {
      const int count = round % 37;
      std::vector<int> calls(static_cast<std::size_t>(count));  // tasks write apart: no atomics
      pool.run(count, [&](int i) { ++calls.at(static_cast<std::size_t>(i)); });
      ASSERT_EQ(calls, std::vector<int>(static_cast<std::size_t>(count), 1)) << threads << " threads, round " << round;
    }
  }
}

TEST(ThreadPoolTest, WhatTasksWroteIsSeenAfterTheRound) {
  ThreadPool pool(4);
  std::vector<long> values(1000, 0);
  for (int round = 0; round < 200; ++round) {
    pool.run(1000, [&](int i) { values[static_cast<std::size_t>(i)] += i + round; });
  }
  for (std::size_t i = 0; i < values.size(); ++i) ASSERT_EQ(values[i], 200L * static_cast<long>(i) + 199L * 100L);
}

TEST(ThreadPoolTest, TheThreadsReallyShareTheWork) {
  ThreadPool pool(3);
  // Three tasks that wait for each other finish only when three threads run them.
  std::atomic<int> arrived{0};
  std::vector<std::thread::id> ids(3);
  pool.run(3, [&](int i) {
    ids[static_cast<std::size_t>(i)] = std::this_thread::get_id();
    ++arrived;
    while (arrived != 3) std::this_thread::yield();
  });
  EXPECT_EQ(std::set<std::thread::id>(ids.begin(), ids.end()).size(), 3U);
}

TEST(ThreadPoolTest, OneThreadIsTheCallersInOrder) {
  ThreadPool pool(1);
  std::vector<int> order;
  const std::thread::id caller = std::this_thread::get_id();
  pool.run(5, [&](int i) {
    EXPECT_EQ(std::this_thread::get_id(), caller);
    order.push_back(i);
  });
  EXPECT_EQ(order, (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST(ThreadPoolTest, GoesAwayWithoutEverWorking) {
  for (int k = 0; k < 50; ++k) const ThreadPool pool(4);
}

}  // namespace
}  // namespace submapd
