// The thread that drives the back end: hears of finished sub-maps over LCM only, feeds them in order, hands out the
// graph.
//
// A message is believed only if its run is ours and its hash is the one the archive's journal holds. A sub-map that got
// lost on the way is noticed by a later one, or by announce(), and read again from the archive. The graph goes out on
// CART_GRAPH; the daemon itself takes it in-process from latest().
//
// The object belongs to the thread that made it; announce(), latest(), counters(), status() and wait_until_processed()
// may be called from any thread. No exception leaves it: what stops the thread is status().
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "daemon/mutex.hpp"
#include "proto/channels.hpp"
#include "proto/submap_chunks.hpp"
#include "slam/base/ids.hpp"
#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/submap/submap_source.hpp"

namespace lcm {
class LCM;
struct ReceiveBuffer;
class Subscription;
}  // namespace lcm

namespace submapd {

struct OptimizerThreadOptions {
  Uuid cart;
  Uuid run;
  Channels channels;
  int queue_capacity = 64;                        // messages LCM keeps while a sub-map is worked on (about 60 kB each)
  std::size_t chunk_bytes_limit = 4U << 20;       // of unfinished sub-maps; what is pushed out is read from the archive
  std::chrono::milliseconds lost_after{200};      // an announced sub-map that is not there by then is lost; 0 in replay
  bool lost_is_error = false;                     // replay over memq://, where nothing can get lost
  std::chrono::microseconds graph_pace{2000};     // between the parts of a graph; 0 for memq://
  std::chrono::seconds no_progress_timeout{600};  // after which wait_until_processed() gives up
};

// All monotonic.
struct OptimizerThreadCounters {
  ChunkCounters chunks;
  std::uint64_t lost = 0;     // sub-maps that did not come whole over LCM
  std::uint64_t reread = 0;   // of them, read from the archive
  std::uint64_t submaps = 0;  // given to the back end
  std::uint64_t graphs_published = 0;
  std::uint64_t publish_errors = 0;
};

class OptimizerThread {
 public:
  // Subscribes and starts. All references must outlive the object. `source` and `back_end` are used by the thread only.
  // `known_hash` is called by the thread. For memq:// `lcm` is the publisher's instance, and this thread then
  // dispatches all its subscriptions; for udpm:// give the thread its own. An instance that is not good() is left
  // alone: everything comes from the archive then, upon announce().
  OptimizerThread(OptimizerThreadOptions options, lcm::LCM& lcm, ChunkAssembler::KnownHash known_hash,
                  SubmapSource& source, BackEnd& back_end);
  OptimizerThread(const OptimizerThread&) = delete;
  OptimizerThread& operator=(const OptimizerThread&) = delete;
  // Stops: waits for what the back end is just doing, and for nothing else.
  ~OptimizerThread();

  // Sub-maps up to `last_index` are in the archive and have been published: what CART_HEALTH says.
  void announce(std::uint32_t last_index);

  // Announces `index` and returns when the back end has taken it. Errors: that of the thread, or kUnavailable when
  // no sub-map was taken for no_progress_timeout.
  [[nodiscard]] Status wait_until_processed(std::uint32_t index);

  // Processes what has been announced, then runs BackEnd::finish() in the thread.
  [[nodiscard]] Expected<FinalResult> finish();

  // The map as it would be if `open`, a sub-map that still grows, were the last: BackEnd::finish_with() in the thread,
  // once all before it are taken. REQUIRES: those are in the archive. One caller at a time.
  [[nodiscard]] Expected<FinalResult> finish_with(std::shared_ptr<const FinishedSubmap> open);

  [[nodiscard]] GraphState latest() const;
  [[nodiscard]] std::uint32_t version() const;  // of latest()
  // Where the newest sub-map of the graph lies: latest() without the copy.
  [[nodiscard]] std::optional<SubmapPose> newest() const;
  [[nodiscard]] OptimizerThreadCounters counters() const;
  [[nodiscard]] OptimizerCounters back_end_counters() const;  // as after the last sub-map
  [[nodiscard]] Status status() const;                        // not ok: the thread has ended with this error

 private:
  class WakeUp;  // makes poll() return

  // Of the thread.
  void run(const std::stop_token& stop);
  [[nodiscard]] Status loop(const std::stop_token& stop);
  [[nodiscard]] Status drain(const std::stop_token& stop);
  [[nodiscard]] Status take_complete(const ChunkAssembler::Complete& complete);
  [[nodiscard]] Status read_lost(std::uint32_t end, const std::stop_token& stop);
  [[nodiscard]] Status feed(const std::shared_ptr<const FinishedSubmap>& submap);
  void publish_graph(const GraphState& state, const FinishedSubmap& newest);
  static void on_chunk(const lcm::ReceiveBuffer* buffer, const std::string& channel, OptimizerThread* self);
  void answer_finish();
  [[nodiscard]] Expected<FinalResult> wait_for_result();

  const OptimizerThreadOptions options_;
  lcm::LCM& lcm_;
  int receive_fd_ = -1;  // -1: LCM cannot receive
  SubmapSource& source_;
  BackEnd& back_end_;
  const std::unique_ptr<WakeUp> wake_up_;
  lcm::Subscription* subscription_ = nullptr;

  // Of the thread alone.
  ChunkAssembler assembler_;
  std::optional<ChunkAssembler::Complete> complete_;  // by the message just handled
  std::uint32_t next_ = 0;                            // index the back end takes next

  mutable Mutex mutex_;
  std::condition_variable_any changed_;
  std::int64_t announced_ GUARDED_BY(mutex_) = -1;
  std::uint32_t processed_ GUARDED_BY(mutex_) = 0;  // sub-maps the back end has taken
  bool ended_ GUARDED_BY(mutex_) = false;
  bool finish_wanted_ GUARDED_BY(mutex_) = false;
  std::shared_ptr<const FinishedSubmap> open_ GUARDED_BY(mutex_);  // finish_wanted_ with this on top
  std::optional<Expected<FinalResult>> final_result_ GUARDED_BY(mutex_);
  Status status_ GUARDED_BY(mutex_);
  GraphState latest_ GUARDED_BY(mutex_);
  OptimizerThreadCounters counters_ GUARDED_BY(mutex_);
  OptimizerCounters back_end_counters_ GUARDED_BY(mutex_);

  std::jthread thread_;  // last: it ends before what it uses
};

}  // namespace submapd
