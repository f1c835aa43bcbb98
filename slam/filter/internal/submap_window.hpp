// The sub-maps of the moment (design notes 7): the front that scans are matched against, the younger one that shares
// its second half and will take over, and a third that is free, or finished and not yet taken.
//
// Owned and called by the mapper, but for has_finished() and take_finished(), which one other thread may call: a
// finished sub-map is that thread's until it is taken. No allocation after construction but in take_finished().
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "slam/filter/particle_set.hpp"
#include "slam/submap/active_submap.hpp"

namespace submapd {

class SubmapWindow {
 public:
  SubmapWindow(const IndexMapOptions& options, const SubmapLimits& limits, DistanceLayers& layers, int max_beams);

  // A front sub-map is open: true from open_front() to close().
  [[nodiscard]] bool is_open() const { return front_open_; }
  [[nodiscard]] const ActiveSubmap& front() const { return *front_; }
  // The younger sub-map holds at least this many key-frames.
  [[nodiscard]] bool younger_has(int keyframes) const { return back_open_ && back_->keyframes() >= keyframes; }
  [[nodiscard]] bool may_hand_over() const { return back_open_ && !has_finished(); }
  [[nodiscard]] bool may_close() const { return !has_finished(); }

  void open_front(const Pose2& odom_from_submap, bool linked);
  // Index of the sub-map that is opened next. REQUIRES: none is open.
  void count_from(std::uint32_t index) { next_index_ = index; }

  // Everything that is agreed on goes into both; the younger is opened at the front's half time. `pose` in the front's
  // frame. REQUIRES: room() > 0.
  void insert(const Pose2& pose, const KeyframeScan& scan);
  // Key-frames that the front can still take; the younger always has more.
  [[nodiscard]] int room() const { return front_->room(); }

  // The front is finished and the younger takes its place; returns the younger's frame from the old front's.
  // REQUIRES: may_hand_over().
  Pose2 hand_over(FinishReason reason);
  // The front is finished and so is its track: what the younger holds, the front holds too. REQUIRES: may_close().
  void close(FinishReason reason);

  [[nodiscard]] bool has_finished() const { return finished_.load() != nullptr; }
  [[nodiscard]] std::optional<FinishedSubmap> take_finished(const Uuid& cart, const Uuid& run);

  [[nodiscard]] std::uint64_t pool_refusals() const;
  [[nodiscard]] std::size_t bytes_used() const;
  [[nodiscard]] std::size_t bytes_peak() const { return peak_bytes_; }
  [[nodiscard]] std::size_t bytes_limit() const;

 private:
  void retire_front(FinishReason reason);

  std::array<std::unique_ptr<ActiveSubmap>, 3> submaps_;
  ActiveSubmap* front_;
  ActiveSubmap* back_;
  ActiveSubmap* spare_;
  std::atomic<const ActiveSubmap*> finished_{nullptr};  // set by the mapper, cleared by who takes it
  FinishReason finish_reason_ = FinishReason::kPath;    // of finished_
  bool front_open_ = false;
  bool back_open_ = false;
  std::uint32_t next_index_ = 0;
  std::size_t peak_bytes_ = 0;
};

}  // namespace submapd
