// Runs two threads in every interleaving and with every stale value that the C++ memory model lets an atomic load
// return.
//
// The threads are fibers that give way before each operation on a ModelAtomic. A depth-first search over all choices
// (which thread goes on, which of the values a load returns) runs the program again and again until none is left.
//
// The memory: each location keeps every value ever stored, in modification order. Each thread has a view, the oldest
// value of each location that it may still read, and a vector clock for "happens before". A release store carries both
// along; an acquire load of it takes them over; a relaxed one does neither. So a thread may read old values of one
// location after new ones of another: what store buffers, invalidation queues and reordering do to a program shows up
// here as a stale read. seq_cst loads see the last seq_cst store of their location and all that the fiber knows. Plain
// cells are checked for data races by the vector clocks. Not modelled: a load that returns a value stored later in
// every interleaving (C++ allows it for relaxed operations whose values depend on each other; no compiler or CPU does
// it where control depends on the value), and a store put before another one in modification order after the fact (no
// location here is stored to by two threads without reading it). The views are those of Kang et al., "A promising
// semantics for relaxed-memory concurrency", POPL 2017, without promises.
#pragma once

#include <ucontext.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace submapd::driver::test {

class Model {
 public:
  static constexpr std::size_t kThreads = 2;
  static constexpr std::size_t kLocations = 8;

  struct Result {
    std::uint64_t executions = 0;
    std::string violation;  // empty: every execution kept every promise
  };

  // `program` makes the shared objects and returns the two threads' bodies; it runs once for each execution.
  using Bodies = std::array<std::function<void()>, kThreads>;
  static Result explore(const std::function<Bodies(Model&)>& program, std::uint64_t most = 50'000'000) {
    Result result;
    Model model;
    do {
      model.begin();
      current() = &model;
      model.bodies_ = program(model);
      model.run();
      if (model.learnt_) {
        model.choices_.clear();
        model.depth_ = 0;
        result.executions = 0;
      }
      if (!model.redundant_) ++result.executions;
      if (!model.violation_.empty()) {
        result.violation = model.violation_;
        return result;
      }
    } while ((model.learnt_ || model.next_choices()) && result.executions < most);
    if (result.executions == most) result.violation = "not finished within the executions allowed";
    return result;
  }

  static Model*& current() {
    static Model* model = nullptr;
    return model;
  }

  // A promise of the program under test.
  void require(bool kept, const char* promise) {
    if (!kept && violation_.empty()) violation_ = promise;
  }

  // Atomics.
  std::size_t new_location(std::uint64_t value) {
    messages_.at(locations_).assign(1, {value, {}});
    return locations_++;
  }

  std::uint64_t load(std::size_t at, std::memory_order order) {
    use(at, false);
    Knowledge& mine = knowledge_[thread_];
    const std::vector<Message>& values = messages_[at];
    std::size_t oldest = mine.view[at];
    if (order == std::memory_order_seq_cst) oldest = std::max(oldest, last_seq_cst_[at]);
    const std::size_t chosen = oldest + choose(values.size() - oldest);
    mine.view[at] = chosen;
    if (order != std::memory_order_relaxed) mine.join(values[chosen].released);
    return values[chosen].value;
  }

  void store(std::size_t at, std::uint64_t value, std::memory_order order) {
    use(at, true);
    append(at, value, order, {});
  }

  // Reads the newest value: nothing may come between a read-modify-write's two halves.
  std::uint64_t exchange(std::size_t at, std::uint64_t value, std::memory_order order) {
    use(at, true);
    const Message old = messages_[at].back();
    Knowledge& mine = knowledge_[thread_];
    if (order != std::memory_order_relaxed && order != std::memory_order_release) mine.join(old.released);
    append(at, value, order, old.released);  // goes on with the release sequence
    return old.value;
  }

  // Plain memory: two accesses of which one writes must not be unordered.
  struct Cell {
    std::uint64_t value = 0;
    std::array<std::uint64_t, kThreads> written{};  // clock of each thread's last write
    std::array<std::uint64_t, kThreads> read{};
  };

  void access(Cell& cell, bool writes) {
    Knowledge& mine = knowledge_[thread_];
    for (std::size_t other = 0; other < kThreads; ++other) {
      require(cell.written[other] <= mine.clock[other], "data race: a slot is used before its last writing is over");
      if (writes) require(cell.read[other] <= mine.clock[other], "data race: a slot is written while it is read");
    }
    ++mine.clock[thread_];
    (writes ? cell.written : cell.read)[thread_] = mine.clock[thread_];
  }

  // The kernel's counter behind an eventfd: not subject to stale reads.
  void wake() {
    ++steps_[thread_];
    give_way({kKernel, true});
    ++wakeups_;
  }

  // False: nobody is left who could wake this thread.
  bool sleep() {
    give_way({kKernel, true});
    while (wakeups_ == 0) {
      if (finished_[1 - thread_]) return false;
      blocked_[thread_] = true;
      give_way({kKernel, true});
    }
    blocked_[thread_] = false;
    wakeups_ = 0;
    return true;
  }

  // Operations that the running thread has done so far.
  [[nodiscard]] std::uint64_t steps() const { return steps_[thread_]; }

 private:
  struct Knowledge {
    std::array<std::size_t, kLocations> view{};
    std::array<std::uint64_t, kThreads> clock{};

    void join(const Knowledge& other) {
      for (std::size_t i = 0; i < kLocations; ++i) view[i] = std::max(view[i], other.view[i]);
      for (std::size_t i = 0; i < kThreads; ++i) clock[i] = std::max(clock[i], other.clock[i]);
    }
  };

  struct Message {
    std::uint64_t value = 0;
    Knowledge released;
  };

  // What a thread will do next.
  struct Operation {
    std::size_t location = 0;
    bool stores = false;
  };

  static bool commute(const Operation& a, const Operation& b) {
    return a.location != b.location || (!a.stores && !b.stores);
  }

  static constexpr std::size_t kKernel = kLocations;  // the counter's place among the locations
  static constexpr std::size_t kStack = 64 * 1024;

  void append(std::size_t at, std::uint64_t value, std::memory_order order, Knowledge released) {
    Knowledge& mine = knowledge_[thread_];
    const std::size_t index = messages_[at].size();
    mine.view[at] = index;
    const bool releases = order != std::memory_order_relaxed && order != std::memory_order_acquire;
    if (releases) released.join(mine);
    if (order == std::memory_order_seq_cst) last_seq_cst_[at] = index;
    messages_[at].push_back({value, released});
  }

  // One of 0..count-1: all of them, one execution after the other.
  std::size_t choose(std::size_t count) {
    if (count <= 1) return 0;
    if (depth_ == choices_.size()) choices_.push_back({0, count});
    return choices_[depth_++].taken;
  }

  bool next_choices() {
    choices_.resize(depth_);
    while (!choices_.empty() && choices_.back().taken + 1 == choices_.back().count) choices_.pop_back();
    if (choices_.empty()) return false;
    ++choices_.back().taken;
    return true;
  }

  void begin() {
    depth_ = 0;
    locations_ = 0;
    knowledge_ = {};
    last_seq_cst_ = {};
    wakeups_ = 0;
    finished_ = {};
    blocked_ = {};
    steps_ = {};
    thread_ = 0;
    learnt_ = false;
    redundant_ = false;
    asleep_ = {};
    pending_ = {};
    violation_.clear();
  }

  [[nodiscard]] bool runnable(std::size_t thread) const {
    if (finished_[thread]) return false;
    return !blocked_[thread] || wakeups_ > 0 || finished_[1 - thread];
  }

  void run() {
    for (std::size_t i = 0; i < kThreads; ++i) prepare(stacks_[i], contexts_[i]);
    for (thread_ = 0; thread_ < kThreads; ++thread_) swapcontext(&scheduler_, &contexts_[thread_]);
    while (runnable(0) || runnable(1)) {
      const bool first = runnable(0) && !asleep_[0];
      const bool second = runnable(1) && !asleep_[1];
      if (!first && !second) {  // all that could follow was followed from another order
        redundant_ = true;
        return;
      }
      thread_ = first && second ? choose(2) : (first ? 0 : 1);
      if (first && second && thread_ == 1) asleep_[0] = true;  // what begins with thread 0 was followed before
      const std::size_t other = 1 - thread_;
      const Operation done = pending_[thread_];
      swapcontext(&scheduler_, &contexts_[thread_]);
      if (!commute(done, pending_[other])) asleep_[other] = false;
    }
    require(finished_[0] && finished_[1], "deadlock");
  }

  static void prepare(std::vector<char>& stack, ucontext_t& context) {
    stack.resize(kStack);
    getcontext(&context);
    context.uc_stack.ss_sp = stack.data();
    context.uc_stack.ss_size = stack.size();
    context.uc_link = nullptr;
    makecontext(&context, &Model::entry, 0);
  }

  static void entry() {
    Model& model = *current();
    const std::size_t mine = model.thread_;
    model.bodies_[mine]();
    model.finished_[mine] = true;
    for (;;) swapcontext(&model.contexts_[mine], &model.scheduler_);
  }

  void use(std::size_t at, bool stores) {
    const std::size_t other = 1 - thread_;
    learn(used_[at][thread_]);
    if (stores) learn(stored_[at][thread_]);
    ++steps_[thread_];
    const bool noticed = stores ? used_[at][other] : stored_[at][other];
    if (noticed) give_way({at, stores});
  }

  void learn(bool& fact) {
    learnt_ = learnt_ || !fact;
    fact = true;
  }

  void give_way(Operation next) {
    const std::size_t mine = thread_;
    pending_[mine] = next;
    swapcontext(&contexts_[mine], &scheduler_);
  }

  struct Choice {
    std::size_t taken;
    std::size_t count;
  };

  std::vector<Choice> choices_;
  std::size_t depth_ = 0;
  std::array<std::vector<Message>, kLocations> messages_;
  std::size_t locations_ = 0;
  std::array<Knowledge, kThreads> knowledge_{};
  std::array<std::size_t, kLocations> last_seq_cst_{};
  std::uint64_t wakeups_ = 0;
  std::array<bool, kThreads> finished_{};
  std::array<bool, kThreads> blocked_{};
  std::array<std::uint64_t, kThreads> steps_{};
  std::size_t thread_ = 0;
  std::array<std::array<bool, kThreads>, kLocations> used_{};    // by which thread, in any execution
  std::array<std::array<bool, kThreads>, kLocations> stored_{};  // to, by which thread
  bool learnt_ = false;
  bool redundant_ = false;
  std::array<bool, kThreads> asleep_{};
  std::array<Operation, kThreads> pending_{};
  std::string violation_;
  Bodies bodies_;
  std::array<std::vector<char>, kThreads> stacks_;
  std::array<ucontext_t, kThreads> contexts_{};
  ucontext_t scheduler_{};
};

// std::atomic's part that the ring uses, in the model. Map turns an order into the one that is really used: a way to
// break the program and see whether the model notices.
template <typename T, std::memory_order (*Map)(std::memory_order)>
class ModelAtomic {
 public:
  explicit ModelAtomic(T value) : location_(Model::current()->new_location(value)) {}
  T load(std::memory_order order) const { return static_cast<T>(Model::current()->load(location_, Map(order))); }
  void store(T value, std::memory_order order) { Model::current()->store(location_, value, Map(order)); }
  T exchange(T value, std::memory_order order) {
    return static_cast<T>(Model::current()->exchange(location_, value, Map(order)));
  }

 private:
  std::size_t location_;
};

}  // namespace submapd::driver::test
