// Every interleaving and every stale read of the ring and its doorbell, run on their very code; and proof that the
// model would notice weaker memory orders.
#include <gtest/gtest.h>

#include <chrono>
#include <memory>

#include "driver/ring/spsc_ring.hpp"
#include "tests/unit/driver/ring/weak_memory_model.hpp"

namespace submapd::driver::test {
namespace {

using std::memory_order;

constexpr memory_order as_written(memory_order order) {
  return order;
}
// Each of these is a bug that the model must find.
constexpr memory_order no_release(memory_order order) {
  return order == std::memory_order_release ? std::memory_order_relaxed : order;
}
constexpr memory_order no_acquire(memory_order order) {
  return order == std::memory_order_acquire ? std::memory_order_relaxed : order;
}
constexpr memory_order all_relaxed(memory_order) {
  return std::memory_order_relaxed;
}
// Loads acquire, stores release: enough for the slots, not for the doorbell.
constexpr memory_order no_seq_cst(memory_order order) {
  return order == std::memory_order_seq_cst ? std::memory_order_acq_rel : order;
}

class ModelSleeper {
 public:
  void wake() noexcept { Model::current()->wake(); }
  bool sleep(std::chrono::milliseconds) noexcept { return Model::current()->sleep(); }
};

struct ModelSlot {
  Model::Cell cell;
  void write(std::uint64_t value) {
    Model::current()->access(cell, true);
    cell.value = value;
  }
  [[nodiscard]] std::uint64_t read() const {
    Model::current()->access(const_cast<Model::Cell&>(cell), false);
    return cell.value;
  }
};

template <memory_order (*Map)(memory_order)>
struct Program {
  template <typename T>
  using Atomic = ModelAtomic<T, Map>;
  using Bell = BasicDoorbell<Atomic, ModelSleeper>;
  using Ring = SpscRing<ModelSlot, Atomic, Bell>;

  // What one execution shares. Counts of the test itself are plain: fibers never run at the same time.
  struct Shared {
    Shared(std::size_t capacity, bool sleeps) : bell(ModelSleeper()), ring(capacity, sleeps ? &bell : nullptr) {}
    Bell bell;
    Ring ring;
    std::uint64_t published = 0;
    std::uint64_t received = 0;
    std::uint64_t last = 0;
  };

  static void produce(Model& model, Shared& shared, int values) {
    std::uint64_t refused = 0;
    for (int i = 1; i <= values; ++i) {
      const std::uint64_t before = model.steps();
      if (ModelSlot* const slot = shared.ring.claim()) {
        slot->write(static_cast<std::uint64_t>(i));
        shared.ring.publish();
        ++shared.published;
      } else {
        ++refused;
      }
      model.require(model.steps() - before <= 8, "the producer's step is bounded");
    }
    model.require(shared.ring.dropped() == refused, "each drop is counted, once");
    model.require(shared.ring.published() == shared.published, "each value handed on is counted");
  }

  static void take(Model& model, Shared& shared, const ModelSlot& slot) {
    const std::uint64_t value = slot.read();
    model.require(value > shared.last, "values come in order, none twice");
    shared.last = value;
    ++shared.received;
    shared.ring.pop();
  }

  // The consumer sleeps whenever there is nothing, until the producer is gone and nobody wakes it.
  static Model::Bodies sleeping_consumer(Model& model, std::size_t capacity, int values) {
    auto shared = std::make_shared<Shared>(capacity, true);
    return {[&model, shared, values] { produce(model, *shared, values); },
            [&model, shared] {
              const auto has_data = [&] { return shared->ring.has_data(); };
              while (shared->bell.wait(has_data, std::chrono::hours(1))) {
                while (const ModelSlot* const slot = shared->ring.front()) take(model, *shared, *slot);
              }
              model.require(shared->received == shared->published, "no wake-up is lost");
            }};
  }

  // The consumer looks a number of times and never sleeps: the slots alone.
  static Model::Bodies looking_consumer(Model& model, std::size_t capacity, int values, int looks) {
    auto shared = std::make_shared<Shared>(capacity, false);
    return {[&model, shared, values] { produce(model, *shared, values); },
            [&model, shared, looks] {
              for (int i = 0; i < looks; ++i) {
                if (const ModelSlot* const slot = shared->ring.front()) take(model, *shared, *slot);
              }
            }};
  }
};

template <memory_order (*Map)(memory_order)>
Model::Result sleeping(std::size_t capacity, int values) {
  return Model::explore([=](Model& model) { return Program<Map>::sleeping_consumer(model, capacity, values); });
}

template <memory_order (*Map)(memory_order)>
Model::Result looking(std::size_t capacity, int values, int looks) {
  return Model::explore([=](Model& model) { return Program<Map>::looking_consumer(model, capacity, values, looks); });
}

void expect_sound(const Model::Result& result, std::uint64_t at_least) {
  EXPECT_EQ(result.violation, "") << "after " << result.executions << " executions";
  EXPECT_GE(result.executions, at_least);
  std::printf("%llu executions\n", static_cast<unsigned long long>(result.executions));
}

TEST(RingModel, SlotsAreHandedOverInEveryExecution) {
  expect_sound(looking<as_written>(1, 5, 5), 1000);
  expect_sound(looking<as_written>(2, 5, 5), 1000);
}

TEST(RingModel, NoWakeUpIsLostInAnyExecution) {
  expect_sound(sleeping<as_written>(1, 3), 1000);
  expect_sound(sleeping<as_written>(2, 2), 500);
}

TEST(RingModel, TheModelFindsMissingReleases) {
  EXPECT_NE(looking<no_release>(1, 3, 3).violation, "");
  EXPECT_NE(looking<all_relaxed>(2, 3, 3).violation, "");
}

TEST(RingModel, TheModelFindsMissingAcquires) {
  EXPECT_NE(looking<no_acquire>(1, 3, 3).violation, "");
}

TEST(RingModel, TheModelFindsTheLostWakeUpOfWeakerOrders) {
  EXPECT_EQ(sleeping<no_seq_cst>(2, 2).violation, "no wake-up is lost");
}

}  // namespace
}  // namespace submapd::driver::test
