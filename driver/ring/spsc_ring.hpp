// A lock-free ring of fixed slots between one producer thread and one consumer thread.
//
// Slots are filled and read in place. When the ring is full the newest value is dropped and counted; the producer never
// waits, whatever the consumer does. All memory is taken by the constructor.
//
//   producer                                    consumer
//   if (Slot* slot = ring.claim()) {            while (const Slot* slot = ring.front()) {
//     fill(*slot);                                read(*slot);
//     ring.publish();                             ring.pop();
//   }                                           }
//                                               bell.wait([&] { return ring.has_data(); }, 100ms);
//
// Threads: claim() and publish() by the producer, front(), pop() and has_data() by the consumer, size(), published(),
// dropped() and capacity() by any. Nothing throws, allocates, locks or blocks after construction.
//
// Memory orders. tail_ counts what was published, head_ what was popped; both only grow (2^64 scans do not run out),
// each has one writer, so that a writer reads its own index relaxed. A slot changes hands twice:
//   to the consumer  publish() stores tail_ (at least release) after the slot was filled; front() loads it by
//                    acquire: if it sees the new count, it sees the filling.
//   back again       pop() stores head_ by release after the slot was read; claim() loads it by acquire: if it
//                    sees the new count, the reading is over before the filling begins.
// A stale index is harmless: the consumer finds the ring emptier, the producer finds it fuller than it is. That is also
// why each side keeps a copy of the other's index and looks again only when the copy says "empty" or "full": the cache
// line of the other side then rarely travels. publish() stores by seq_cst, not only release, because the doorbell's
// mark is loaded behind it (Doorbell::wait()).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "driver/ring/doorbell.hpp"

namespace submapd::driver {

// Atomic and Bell are parameters so that the model check (tests/unit/driver/ring) runs this very code.
template <typename Slot, template <typename> class Atomic = std::atomic, typename Bell = Doorbell>
class SpscRing {
 public:
  // REQUIRES: capacity > 0. The bell, if there is one, must outlive the ring; several rings may share it.
  explicit SpscRing(std::size_t capacity, Bell* bell = nullptr)
      : capacity_(capacity), bell_(bell), slots_(std::make_unique<Slot[]>(capacity)) {}
  SpscRing(const SpscRing&) = delete;
  SpscRing& operator=(const SpscRing&) = delete;

  // A free slot to fill, with whatever it held before; nullptr if the ring is full: then the value is dropped, which is
  // counted here, once a call. A claimed slot that is not published is claimed again by the next call.
  [[nodiscard]] Slot* claim() noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - producers_head_ == capacity_) {
      producers_head_ = head_.load(std::memory_order_acquire);
      if (tail - producers_head_ == capacity_) {
        // One writer: no read-modify-write needed. Relaxed: a count, it orders nothing.
        dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        return nullptr;
      }
    }
    return &slots_[tail_slot_];
  }

  // Hands the claimed slot to the consumer and wakes it if it sleeps.
  // REQUIRES: claim() returned a slot since the last publish().
  void publish() noexcept {
    tail_slot_ = tail_slot_ + 1 == capacity_ ? 0 : tail_slot_ + 1;
    tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_seq_cst);
    if (bell_ != nullptr) bell_->ring();
  }

  // The oldest value, nullptr if there is none. It stays the consumer's until pop().
  [[nodiscard]] const Slot* front() noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == consumers_tail_) {
      consumers_tail_ = tail_.load(std::memory_order_acquire);
      if (head == consumers_tail_) return nullptr;
    }
    return &slots_[head_slot_];
  }

  // Gives the slot of front() back. REQUIRES: front() returned a slot since the last pop().
  void pop() noexcept {
    head_slot_ = head_slot_ + 1 == capacity_ ? 0 : head_slot_ + 1;
    head_.store(head_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }

  // For Doorbell::wait().
  [[nodiscard]] bool has_data() const noexcept {
    return tail_.load(std::memory_order_seq_cst) != head_.load(std::memory_order_relaxed);
  }

  // Exact; to another thread than the producer they may be some calls old.
  // Values that wait.
  [[nodiscard]] std::uint64_t size() const noexcept {
    const std::uint64_t popped = head_.load(std::memory_order_relaxed);
    return tail_.load(std::memory_order_relaxed) - popped;
  }
  [[nodiscard]] std::uint64_t published() const noexcept { return tail_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::size_t capacity() const noexcept { return capacity_; }

 private:
  static constexpr std::size_t kCacheLine = 64;

  const std::size_t capacity_;
  Bell* const bell_;
  const std::unique_ptr<Slot[]> slots_;

  // The producer's line.
  alignas(kCacheLine) Atomic<std::uint64_t> tail_{0};
  Atomic<std::uint64_t> dropped_{0};
  std::uint64_t producers_head_ = 0;  // head_ as the producer last saw it
  std::size_t tail_slot_ = 0;         // tail_ modulo capacity_

  // The consumer's line. alignas of the class keeps what follows the ring off it.
  alignas(kCacheLine) Atomic<std::uint64_t> head_{0};
  std::uint64_t consumers_tail_ = 0;  // tail_ as the consumer last saw it
  std::size_t head_slot_ = 0;
};

}  // namespace submapd::driver
