// The optimizer thread over memq://, where every message arrives in order, so that each outcome is exact.
#include "daemon/optimizer_thread.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/graph_conversion.hpp"
#include "tests/support/optimizer_rig.hpp"

namespace submapd {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class OptimizerThreadTest : public testing::Test {
 protected:
  OptimizerThreadTest() { rig.sizes.blocks = 40; }  // three chunks
  OptimizerRig rig{"memq://"};
};

TEST_F(OptimizerThreadTest, FeedsInOrderAndTheBarrierHolds) {
  rig.options.lost_is_error = true;
  rig.start();
  for (std::uint32_t i = 0; i < 5; ++i) {
    ASSERT_TRUE(rig.save_and_send(i));
    ASSERT_TRUE(rig.thread->wait_until_processed(i).ok());
    EXPECT_EQ(rig.back_end.indices().size(), i + 1);  // no later than the barrier
    EXPECT_EQ(rig.thread->latest().version, i + 1);
  }
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0, 1, 2, 3, 4));
  for (std::uint32_t i = 0; i < 5; ++i) EXPECT_EQ(rig.back_end.bytes()[i], encode_submap(rig.submap(i)));
  const Expected<FinalResult> result = rig.thread->finish();
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->submaps.size(), 5U);
  const OptimizerThreadCounters counters = rig.thread->counters();
  EXPECT_EQ(counters.submaps, 5U);
  EXPECT_EQ(counters.lost, 0U);
  EXPECT_EQ(counters.chunks.received, 15U);
  EXPECT_EQ(counters.chunks.completed, 5U);
  EXPECT_EQ(counters.chunks.bytes_used, 0U);
  EXPECT_EQ(counters.graphs_published, 5U);
  EXPECT_EQ(rig.thread->back_end_counters().submaps, 5U);
}

TEST_F(OptimizerThreadTest, ManySubmapsInOneGoStayInOrder) {
  rig.start();
  for (std::uint32_t i = 0; i < 10; ++i) ASSERT_TRUE(rig.save_and_send(i));
  ASSERT_TRUE(rig.thread->wait_until_processed(9).ok());
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9));
  EXPECT_EQ(rig.thread->counters().lost, 0U);
}

TEST_F(OptimizerThreadTest, MissingChunkIsReadFromTheArchive) {
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  rig.save(1);
  std::vector<submap_chunk_t> chunks = rig.chunks(rig.submap(1));
  ASSERT_GE(chunks.size(), 3U);
  chunks.erase(chunks.begin() + 1);
  for (const submap_chunk_t& chunk : chunks) rig.send_message(encode_message(chunk));
  ASSERT_TRUE(rig.save_and_send(2));
  ASSERT_TRUE(rig.thread->wait_until_processed(2).ok());
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0, 1, 2));
  EXPECT_EQ(rig.back_end.bytes()[1], encode_submap(rig.submap(1)));
  EXPECT_EQ(rig.thread->counters().lost, 1U);
  EXPECT_EQ(rig.thread->counters().reread, 1U);
  EXPECT_EQ(rig.thread->counters().chunks.bytes_used, 0U);  // the unfinished one was let go
}

TEST_F(OptimizerThreadTest, LostLastOneIsNoticedByTheAnnouncement) {
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  rig.save(1);
  rig.save(2);
  ASSERT_TRUE(rig.thread->wait_until_processed(2).ok());
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0, 1, 2));
  EXPECT_EQ(rig.thread->counters().reread, 2U);
}

TEST_F(OptimizerThreadTest, LostIsAnErrorInReplay) {
  rig.options.lost_is_error = true;
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  rig.save(1);
  const Status status = rig.thread->wait_until_processed(1);
  EXPECT_EQ(status.code(), StatusCode::kInternal);
  EXPECT_THAT(status.message(), HasSubstr("sub-map 1 was lost"));
  EXPECT_EQ(rig.thread->finish().error().message(), status.message());
  EXPECT_EQ(rig.thread->status().message(), status.message());
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0));
}

TEST_F(OptimizerThreadTest, LostAndNotInTheArchiveIsAnError) {
  rig.start();
  EXPECT_EQ(rig.thread->wait_until_processed(0).code(), StatusCode::kNotFound);
}

TEST_F(OptimizerThreadTest, ForeignForgedAndBrokenAreCountedAndIgnored) {
  rig.options.lost_is_error = true;
  rig.start();
  FinishedSubmap foreign = rig.submap(0);
  foreign.id.run = Uuid::from_seed(99, 99);
  for (const submap_chunk_t& chunk : rig.chunks(foreign)) rig.send_message(encode_message(chunk));
  FinishedSubmap forged = rig.submap(0);
  forged.odom_from_submap.x += 1.0;
  for (const submap_chunk_t& chunk : rig.chunks(forged)) rig.send_message(encode_message(chunk));
  rig.send_message(std::vector<std::byte>(100, std::byte{0xFF}));

  ASSERT_TRUE(rig.save_and_send(0));
  ASSERT_TRUE(rig.thread->wait_until_processed(0).ok());
  EXPECT_EQ(rig.back_end.bytes()[0], encode_submap(rig.submap(0)));
  const OptimizerThreadCounters counters = rig.thread->counters();
  EXPECT_EQ(counters.chunks.foreign, 3U);
  EXPECT_EQ(counters.chunks.forged, 3U);
  EXPECT_EQ(counters.chunks.bad, 1U);
  EXPECT_EQ(counters.submaps, 1U);
}

// The hash is no secret: who sends other data under it makes the sub-map useless on LCM, not wrong.
TEST_F(OptimizerThreadTest, ForgedDataUnderTheRightHashIsDroppedAndReadAgain) {
  rig.start();
  rig.save(0);
  FinishedSubmap forged = rig.submap(0);
  forged.odom_from_submap.x += 1.0;
  const Sha256 right = sha256_of(encode_submap(rig.submap(0))).value();
  for (submap_chunk_t& chunk : rig.chunks(forged)) {
    std::copy(right.begin(), right.end(), std::begin(chunk.sha256));
    rig.send_message(encode_message(chunk));
  }
  ASSERT_TRUE(rig.thread->wait_until_processed(0).ok());
  EXPECT_EQ(rig.back_end.bytes()[0], encode_submap(rig.submap(0)));
  EXPECT_EQ(rig.thread->counters().chunks.damaged, 1U);
  EXPECT_EQ(rig.thread->counters().reread, 1U);
}

TEST_F(OptimizerThreadTest, RepeatedSubmapIsTakenOnce) {
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  ASSERT_TRUE(rig.send(0));
  ASSERT_TRUE(rig.save_and_send(1));
  ASSERT_TRUE(rig.thread->wait_until_processed(1).ok());
  EXPECT_THAT(rig.back_end.indices(), ElementsAre(0, 1));
  EXPECT_EQ(rig.thread->counters().chunks.duplicates, 3U);
}

TEST_F(OptimizerThreadTest, BackEndErrorReachesWaitAndFinish) {
  rig.back_end.fail_at = 1;
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  ASSERT_TRUE(rig.save_and_send(1));
  EXPECT_EQ(rig.thread->wait_until_processed(1).message(), "solver broke");
  EXPECT_EQ(rig.thread->finish().error().message(), "solver broke");
  EXPECT_TRUE(rig.thread->wait_until_processed(0).ok());
}

TEST_F(OptimizerThreadTest, ExceptionOfALibraryBecomesAnError) {
  rig.back_end.throw_at = 0;
  rig.start();
  ASSERT_TRUE(rig.save_and_send(0));
  const Status status = rig.thread->wait_until_processed(0);
  EXPECT_EQ(status.code(), StatusCode::kInternal);
  EXPECT_THAT(status.message(), HasSubstr("library threw"));
}

TEST_F(OptimizerThreadTest, ErrorOfTheFinalSolveLeavesTheThreadRunning) {
  rig.back_end.fail_finish = true;
  rig.start();
  EXPECT_EQ(rig.thread->finish().error().message(), "final solve broke");
  ASSERT_TRUE(rig.save_and_send(0));
  EXPECT_TRUE(rig.thread->wait_until_processed(0).ok());
}

TEST_F(OptimizerThreadTest, FinishTakesFirstWhatWasAnnounced) {
  rig.options.lost_after = std::chrono::hours(1);  // only finish() cuts this short
  rig.start();
  rig.save(0);
  rig.thread->announce(0);
  const Expected<FinalResult> result = rig.thread->finish();
  ASSERT_TRUE(result.has_value());
  EXPECT_EQ(result->submaps.size(), 1U);
}

TEST_F(OptimizerThreadTest, FinishWithTakesFirstWhatIsInTheArchive) {
  rig.start();
  for (std::uint32_t i = 0; i < 3; ++i) rig.save(i);  // never sent
  const Expected<FinalResult> result = rig.thread->finish_with(std::make_shared<const FinishedSubmap>(rig.submap(3)));
  ASSERT_TRUE(result.has_value()) << result.error().message();
  EXPECT_EQ(result->submaps.size(), 4U);
  EXPECT_EQ(rig.back_end.indices().size(), 3U);
  EXPECT_EQ(rig.thread->newest()->index, 2U);
  ASSERT_TRUE(rig.save_and_send(3));
  EXPECT_TRUE(rig.thread->wait_until_processed(3).ok()) << "and it goes on";
}

TEST_F(OptimizerThreadTest, BarrierGivesUpWhenNothingMoves) {
  rig.options.lost_after = std::chrono::hours(1);
  rig.options.no_progress_timeout = std::chrono::seconds(0);
  rig.start();
  rig.save(0);
  EXPECT_EQ(rig.thread->wait_until_processed(0).code(), StatusCode::kUnavailable);
}

TEST_F(OptimizerThreadTest, StopsWhileIdleAndWhileWaitingForALostOne) {
  rig.start();
  rig.thread.reset();
  rig.options.lost_after = std::chrono::hours(1);
  rig.start();
  rig.thread->announce(3);
  rig.thread.reset();
  EXPECT_TRUE(rig.back_end.indices().empty());
}

TEST_F(OptimizerThreadTest, WaitersOnSeveralThreads) {
  rig.start();
  std::vector<std::thread> waiters;
  for (std::uint32_t i = 0; i < 4; ++i) ASSERT_TRUE(rig.save_and_send(i));
  for (std::uint32_t i = 0; i < 4; ++i) {
    waiters.emplace_back([this, i] {
      EXPECT_TRUE(rig.thread->wait_until_processed(i).ok());
      EXPECT_GT(rig.thread->latest().version, i);
    });
  }
  for (std::thread& waiter : waiters) waiter.join();
}

struct GraphListener {
  static void on_graph(const lcm::ReceiveBuffer* buffer, const std::string& /*channel*/, GraphListener* self) {
    Expected<GraphPart> part = decode_graph_part({static_cast<const std::byte*>(buffer->data), buffer->data_size});
    ASSERT_TRUE(part.has_value());
    if (std::optional<GraphState> state = self->assembler.add(std::move(*part))) {
      self->versions.push_back(state->version);
    }
  }
  GraphAssembler assembler;
  std::vector<std::uint32_t> versions;
};

TEST_F(OptimizerThreadTest, GraphIsPublished) {
  GraphListener listener;
  rig.sender().subscribeFunction(rig.options.channels.graph, &GraphListener::on_graph, &listener);
  rig.start();
  for (std::uint32_t i = 0; i < 3; ++i) {
    ASSERT_TRUE(rig.save_and_send(i));
    ASSERT_TRUE(rig.thread->wait_until_processed(i).ok());
  }
  rig.thread.reset();
  while (rig.sender().handleTimeout(0) > 0) {
  }
  EXPECT_THAT(listener.versions, ElementsAre(1, 2, 3));
}

// A cart without a multicast route: everything comes from the archive.
TEST(OptimizerThreadWithoutLcm, ReadsTheArchiveUponAnnouncement) {
  OptimizerRig rig("nonsense://");
  ASSERT_FALSE(rig.sender().good());
  rig.options.lost_after = std::chrono::milliseconds(0);
  rig.start();
  EXPECT_FALSE(rig.save_and_send(0));
  ASSERT_TRUE(rig.thread->wait_until_processed(0).ok());
  EXPECT_EQ(rig.thread->counters().reread, 1U);
}

// LCM is there and cannot receive, as under a packet filter: nobody listens at that port.
TEST(OptimizerThreadWithoutLcm, ReadsTheArchiveIfLcmCannotReceive) {
  OptimizerRig rig("tcpq://127.0.0.1:1");
  ASSERT_TRUE(rig.sender().good());
  rig.options.lost_after = std::chrono::milliseconds(0);
  rig.start();
  (void)rig.save_and_send(0);
  ASSERT_TRUE(rig.thread->wait_until_processed(0).ok());
  EXPECT_EQ(rig.thread->counters().reread, 1U);
}

}  // namespace
}  // namespace submapd
