// The optimizer thread over real multicast, which may lose messages: whatever gets lost, the back end gets everything
// in order.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numeric>
#include <vector>

#include "tests/support/optimizer_rig.hpp"

namespace submapd {
namespace {

constexpr const char* kUrl = "udpm://239.255.76.67:7667?ttl=0";

std::vector<std::uint32_t> first(std::size_t count) {
  std::vector<std::uint32_t> indices(count);
  std::iota(indices.begin(), indices.end(), 0U);
  return indices;
}

class OptimizerUdpmTest : public testing::Test {
 protected:
  OptimizerUdpmTest() { rig.sizes.blocks = 40; }  // three chunks
  void SetUp() override {
    ASSERT_TRUE(rig.sender().good()) << "no multicast route: run by tests/process/in_own_network.sh";
  }
  OptimizerRig rig{kUrl};
};

TEST_F(OptimizerUdpmTest, PacedChunksArriveAndGoInOrder) {
  rig.options.lost_after = std::chrono::seconds(20);  // this test wants them over LCM
  rig.start();
  for (std::uint32_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(rig.save_and_send(i));
    ASSERT_TRUE(rig.thread->wait_until_processed(i).ok());
  }
  EXPECT_EQ(rig.back_end.indices(), first(20));
  for (std::uint32_t i = 0; i < 20; ++i) EXPECT_EQ(rig.back_end.bytes()[i], encode_submap(rig.submap(i)));
  const OptimizerThreadCounters counters = rig.thread->counters();
  EXPECT_EQ(counters.chunks.completed + counters.reread, 20U);
  EXPECT_GT(counters.chunks.completed, 10U);
  RecordProperty("lost", static_cast<int>(counters.lost));
}

TEST_F(OptimizerUdpmTest, LostChunksAndLostLastOneAreReadAgain) {
  rig.start();
  for (std::uint32_t i = 0; i < 9; ++i) {
    if (i % 3 == 0) {
      ASSERT_TRUE(rig.save_and_send(i));
      continue;
    }
    rig.save(i);
    std::vector<submap_chunk_t> chunks = rig.chunks(rig.submap(i));
    chunks.pop_back();
    if (i % 3 == 1) rig.send_message(encode_message(chunks.front()));
  }
  ASSERT_TRUE(rig.thread->wait_until_processed(8).ok());
  EXPECT_EQ(rig.back_end.indices(), first(9));
  EXPECT_GE(rig.thread->counters().reread, 6U);
}

TEST_F(OptimizerUdpmTest, StrangersOnTheNetworkChangeNothing) {
  rig.start();
  FinishedSubmap forged = rig.submap(0);
  forged.odom_from_submap.x += 1.0;
  FinishedSubmap foreign = rig.submap(0);
  foreign.id.run = Uuid::from_seed(99, 99);
  rig.send_message(encode_message(rig.chunks(forged).front()));
  rig.send_message(encode_message(rig.chunks(foreign).front()));
  for (int i = 0; i < 10; ++i) rig.send_message(std::vector<std::byte>(1000, static_cast<std::byte>(i)));
  for (std::uint32_t i = 0; i < 3; ++i) ASSERT_TRUE(rig.save_and_send(i));
  ASSERT_TRUE(rig.thread->wait_until_processed(2).ok());
  EXPECT_EQ(rig.back_end.indices(), first(3));
  EXPECT_EQ(rig.back_end.bytes()[0], encode_submap(rig.submap(0)));
}

TEST_F(OptimizerUdpmTest, EverythingAtOnceOverflowsAndIsStillComplete) {
  rig.start();
  for (std::uint32_t i = 0; i < 30; ++i) {
    rig.save(i);
    for (const submap_chunk_t& chunk : rig.chunks(rig.submap(i))) rig.send_message(encode_message(chunk));
  }
  ASSERT_TRUE(rig.thread->wait_until_processed(29).ok());
  EXPECT_EQ(rig.back_end.indices(), first(30));
  const Expected<FinalResult> result = rig.thread->finish();
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->submaps.size(), 30U);
}

}  // namespace
}  // namespace submapd
