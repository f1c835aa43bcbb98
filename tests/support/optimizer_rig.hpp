// An optimizer thread with all it needs - archive, journal, LCM, a recording back end - for tests over memq:// and
// udpm://.
#pragma once

#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "daemon/mutex.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/submap_journal.hpp"
#include "daemon/submap_publisher.hpp"
#include "proto/lcm_message.hpp"
#include "proto/submap_chunks.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/submap/submap_archive.hpp"
#include "slam/submap/submap_codec.hpp"
#include "tests/support/random_submap.hpp"
#include "tests/support/temporary_folder.hpp"

namespace submapd {

// Writes down what it is given. `fail_at`: the call of add_submap() with that index fails. Any thread may read.
class RecordingBackEnd : public BackEnd {
 public:
  Expected<GraphState> add_submap(const std::shared_ptr<const FinishedSubmap>& submap) override {
    const MutexLock lock(mutex_);
    if (static_cast<std::int64_t>(submap->id.index) == fail_at) return failure(StatusCode::kInternal, "solver broke");
    if (static_cast<std::int64_t>(submap->id.index) == throw_at) throw std::runtime_error("library threw");
    bytes_.push_back(encode_submap(*submap));
    indices_.push_back(submap->id.index);
    state_.version += 1;
    state_.submaps.push_back({submap->id.index, submap->odom_from_submap});
    return state_;
  }
  Expected<FinalResult> finish() override {
    if (fail_finish) return failure(StatusCode::kInternal, "final solve broke");
    const MutexLock lock(mutex_);
    FinalResult result;
    result.submaps = state_.submaps;
    return result;
  }
  Expected<FinalResult> finish_with(const std::shared_ptr<const FinishedSubmap>& open) override {
    Expected<FinalResult> result = finish();
    if (result) result->submaps.push_back({open->id.index, open->odom_from_submap});
    return result;
  }
  [[nodiscard]] OptimizerCounters counters() const override {
    const MutexLock lock(mutex_);
    OptimizerCounters counters;
    counters.submaps = indices_.size();
    return counters;
  }

  [[nodiscard]] std::vector<std::uint32_t> indices() const {
    const MutexLock lock(mutex_);
    return indices_;
  }
  [[nodiscard]] std::vector<std::vector<std::byte>> bytes() const {
    const MutexLock lock(mutex_);
    return bytes_;
  }

  // Set before the thread starts.
  std::int64_t fail_at = -1;
  std::int64_t throw_at = -1;
  bool fail_finish = false;

 private:
  mutable Mutex mutex_;
  std::vector<std::uint32_t> indices_ GUARDED_BY(mutex_);
  std::vector<std::vector<std::byte>> bytes_ GUARDED_BY(mutex_);
  GraphState state_ GUARDED_BY(mutex_);
};

class OptimizerRig {
 public:
  explicit OptimizerRig(const std::string& url)
      : memq_(url.starts_with("memq")),
        sender_(url),
        receiver_(memq_ ? "memq://" : url),
        archive_(SubmapArchive::open(folder_.path(), std::size_t{1} << 20).value()),
        publisher_(sender_, publisher_options(memq_)) {
    options.cart = Uuid::from_seed(5, 1);
    options.run = Uuid::from_seed(5, 2);
    if (memq_) options.lost_after = std::chrono::milliseconds(0);
    if (memq_) options.graph_pace = std::chrono::microseconds(0);
  }

  void start() {
    thread = std::make_unique<OptimizerThread>(
        options, memq_ ? sender_ : receiver_,
        [this](std::uint32_t index, const Sha256& hash) { return journal_.find(index) == hash; }, *archive_, back_end);
  }

  [[nodiscard]] FinishedSubmap submap(std::uint32_t index) const {
    return random_submap(5, {options.cart, options.run, index}, sizes);
  }
  // As the mapper's side does: archive, then journal. Returns the hash.
  Sha256 save(std::uint32_t index) {
    const Sha256 hash = archive_->save(submap(index)).value();
    journal_.add(index, hash);
    return hash;
  }
  [[nodiscard]] bool send(std::uint32_t index) {
    const FinishedSubmap finished = submap(index);
    return publisher_.publish(finished, sha256_of(encode_submap(finished)).value()).ok();
  }
  [[nodiscard]] bool save_and_send(std::uint32_t index) {
    save(index);
    return send(index);
  }
  [[nodiscard]] std::vector<submap_chunk_t> chunks(const FinishedSubmap& finished) const {
    const std::vector<std::byte> raw = encode_submap(finished);
    return chunk_submap(finished.id, 0, raw, sha256_of(raw).value(), 0).value();
  }
  void send_message(const std::vector<std::byte>& bytes) {
    sender_.publish(options.channels.submap, bytes.data(), static_cast<unsigned>(bytes.size()));
  }
  [[nodiscard]] lcm::LCM& sender() { return sender_; }

  // Set before start().
  OptimizerThreadOptions options;
  SubmapSizes sizes;
  RecordingBackEnd back_end;

 private:
  static SubmapPublisherOptions publisher_options(bool memq) {
    SubmapPublisherOptions options;
    if (memq) options.pace = std::chrono::microseconds(0);
    return options;
  }

  const bool memq_;
  TemporaryFolder folder_;
  lcm::LCM sender_;
  lcm::LCM receiver_;
  std::unique_ptr<SubmapArchive> archive_;
  SubmapJournal journal_;
  SubmapPublisher publisher_;

 public:
  std::unique_ptr<OptimizerThread> thread;  // last: it uses the others
};

}  // namespace submapd
