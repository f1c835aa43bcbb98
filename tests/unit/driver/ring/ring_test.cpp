// The ring with real threads and a real eventfd: order, exact counts, in-place slots, sleeping and waking.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>

#include "driver/ring/scan_ring.hpp"

namespace submapd::driver::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

Doorbell open_doorbell() {
  return Doorbell(EventFd::open().value());
}

TEST(ScanRing, SlotsAreFilledAndReadInPlaceInOrder) {
  SpscRing<int> ring(3);
  EXPECT_EQ(ring.front(), nullptr);
  int* const first = ring.claim();
  *first = 1;
  ring.publish();
  EXPECT_EQ(ring.front(), first);
  *ring.claim() = 2;
  ring.publish();
  EXPECT_EQ(*ring.front(), 1);
  ring.pop();
  EXPECT_EQ(*ring.front(), 2);
  ring.pop();
  EXPECT_EQ(ring.front(), nullptr);
  EXPECT_EQ(ring.published(), 2U);
  EXPECT_EQ(ring.dropped(), 0U);
}

TEST(ScanRing, AFullRingDropsTheNewestAndCountsIt) {
  SpscRing<int> ring(2);
  for (int i = 0; i < 5; ++i) {
    if (int* const slot = ring.claim()) {
      *slot = i;
      ring.publish();
    }
  }
  EXPECT_EQ(ring.published(), 2U);
  EXPECT_EQ(ring.dropped(), 3U);
  EXPECT_EQ(*ring.front(), 0);
  ring.pop();
  ASSERT_NE(ring.claim(), nullptr);
  EXPECT_EQ(ring.dropped(), 3U);
}

TEST(ScanRing, AClaimThatIsNotPublishedCostsNothing) {
  SpscRing<int> ring(1);
  int* const slot = ring.claim();
  EXPECT_EQ(ring.claim(), slot);
  EXPECT_EQ(ring.front(), nullptr);
  EXPECT_EQ(ring.dropped(), 0U);
}

TEST(ScanRing, WaitingWithoutDataEndsWithItsTime) {
  Doorbell bell = open_doorbell();
  SpscRing<int> ring(1, &bell);
  EXPECT_FALSE(bell.wait([&] { return ring.has_data(); }, milliseconds(1)));
  *ring.claim() = 1;
  ring.publish();
  EXPECT_TRUE(bell.wait([&] { return ring.has_data(); }, milliseconds(0)));
}

// A slot whose every word must be that of the same value: a torn or early read shows.
struct Wide {
  std::array<std::uint64_t, 64> words{};
};

// The producer goes at full speed, the consumer sleeps whenever the ring is empty.
void stress(std::size_t capacity, std::uint64_t values, bool pause) {
  Doorbell bell = open_doorbell();
  SpscRing<Wide> ring(capacity, &bell);
  std::atomic<bool> finished{false};
  std::uint64_t received = 0;
  std::uint64_t torn = 0;
  std::uint64_t last = 0;
  std::thread consumer([&] {
    for (;;) {
      const bool over = finished.load();
      const bool data = bell.wait([&] { return ring.has_data(); }, milliseconds(over ? 0 : 20));
      while (const Wide* const slot = ring.front()) {
        for (const std::uint64_t word : slot->words) torn += word != slot->words.front() ? 1 : 0;
        torn += slot->words.front() <= last ? 1 : 0;  // in order, none twice
        last = slot->words.front();
        ring.pop();
        ++received;
      }
      if (over && !data) return;
    }
  });
  std::uint64_t refused = 0;
  for (std::uint64_t value = 1; value <= values; ++value) {
    if (Wide* const slot = ring.claim()) {
      slot->words.fill(value);
      ring.publish();
    } else {
      ++refused;
    }
    if (pause && value % 64 == 0) std::this_thread::yield();
  }
  finished.store(true);
  consumer.join();
  EXPECT_EQ(torn, 0U);
  EXPECT_EQ(received, ring.published());
  EXPECT_EQ(refused, ring.dropped());
  EXPECT_EQ(received + refused, values);
  EXPECT_GT(received, 0U);
}

TEST(ScanRing, TwoThreadsLoseNothingThatIsNotCounted) {
  stress(1, 100'000, false);
  stress(3, 200'000, false);
  stress(64, 200'000, true);
}

// Each value is answered before the next is sent, so every one of them finds the other side asleep or about to sleep: a
// lost wake-up would show as a wait that ends with its time.
TEST(ScanRing, NoWakeUpIsLostInPingPong) {
  Doorbell there_bell = open_doorbell();
  Doorbell back_bell = open_doorbell();
  SpscRing<int> there(1, &there_bell);
  SpscRing<int> back(1, &back_bell);
  constexpr int kRounds = 20'000;
  const auto hand_over = [](SpscRing<int>& ring, int value) {
    int* const slot = ring.claim();
    ASSERT_NE(slot, nullptr);
    *slot = value;
    ring.publish();
  };
  const auto receive = [](SpscRing<int>& ring, Doorbell& bell) {
    if (!bell.wait([&] { return ring.has_data(); }, seconds(60))) return -1;
    const int value = *ring.front();
    ring.pop();
    return value;
  };
  std::thread other([&] {
    for (int i = 0; i < kRounds; ++i) {
      const int value = receive(there, there_bell);
      hand_over(back, value);
      if (value < 0) return;
    }
  });
  int wrong = 0;
  for (int i = 0; i < kRounds && wrong == 0; ++i) {
    hand_over(there, i);
    wrong += receive(back, back_bell) != i ? 1 : 0;
  }
  other.join();
  EXPECT_EQ(wrong, 0);
}

TEST(ScanRing, OneBellServesTheRingsOfTwoScanners) {
  Doorbell bell = open_doorbell();
  SpscRing<int> horizontal(8, &bell);
  SpscRing<int> vertical(8, &bell);
  constexpr int kValues = 5'000;
  int received = 0;
  std::thread reader([&] {
    const auto has_data = [&] { return horizontal.has_data() || vertical.has_data(); };
    while (received < 2 * kValues && bell.wait(has_data, seconds(60))) {
      for (SpscRing<int>* ring : {&horizontal, &vertical}) {
        while (ring->front() != nullptr) {
          ring->pop();
          ++received;
        }
      }
    }
  });
  const auto push = [](SpscRing<int>& ring) {
    int* slot = ring.claim();
    while (slot == nullptr) {
      std::this_thread::yield();
      slot = ring.claim();
    }
    ring.publish();
  };
  for (int i = 0; i < kValues; ++i) {
    push(horizontal);
    push(vertical);
  }
  reader.join();
  EXPECT_EQ(received, 2 * kValues);
}

TEST(ScanRing, ItsSlotIsAPlainValueOfTheSizePromised) {
  static_assert(std::is_trivially_copyable_v<DeviceScan>);
  EXPECT_LE(sizeof(DeviceScan), 4500U);
}

}  // namespace
}  // namespace submapd::driver::test
