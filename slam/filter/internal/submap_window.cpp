#include "slam/filter/internal/submap_window.hpp"

#include <algorithm>
#include <utility>

namespace submapd {

SubmapWindow::SubmapWindow(const IndexMapOptions& options, const SubmapLimits& limits, DistanceLayers& layers,
                           int max_beams) {
  for (std::unique_ptr<ActiveSubmap>& s : submaps_) {
    s = std::make_unique<ActiveSubmap>(options, limits, layers, max_beams);
  }
  front_ = submaps_[0].get();
  back_ = submaps_[1].get();
  spare_ = submaps_[2].get();
}

void SubmapWindow::open_front(const Pose2& odom_from_submap, bool linked) {
  front_->open(next_index_++, odom_from_submap, linked);
  front_open_ = true;
  back_open_ = false;
}

void SubmapWindow::insert(const Pose2& pose, const KeyframeScan& scan) {
  const Pose2 odom = compose(front_->odom_from_submap(), pose);
  front_->insert(pose, scan.scan, scan.twist, scan.step_covariance, scan.degenerate, scan.beams, scan.origin);
  if (!back_open_ && front_->keyframes() > 1 && front_->fullness() >= 0.5) {
    back_->open(next_index_++, odom, true);
    back_open_ = true;
  }
  if (back_open_) {
    const Pose2 in_back = between(back_->odom_from_submap(), odom);
    back_->insert(in_back, scan.scan, scan.twist, scan.step_covariance, scan.degenerate, scan.beams, scan.origin);
  }
  peak_bytes_ = std::max(peak_bytes_, bytes_used());
}

// The front is finished; the free sub-map stands in its place.
void SubmapWindow::retire_front(FinishReason reason) {
  finish_reason_ = reason;
  ActiveSubmap* const full = front_;
  front_ = spare_;
  spare_ = full;
  back_open_ = false;
  finished_.store(full);
}

Pose2 SubmapWindow::hand_over(FinishReason reason) {
  const Pose2 back_from_front = between(back_->odom_from_submap(), front_->odom_from_submap());
  retire_front(reason);
  std::swap(front_, back_);
  return back_from_front;
}

void SubmapWindow::close(FinishReason reason) {
  if (back_open_) --next_index_;  // its index is free again
  retire_front(reason);
  front_open_ = false;
}

std::optional<FinishedSubmap> SubmapWindow::take_finished(const Uuid& cart, const Uuid& run) {
  const ActiveSubmap* const taken = finished_.load();
  if (taken == nullptr) return std::nullopt;
  FinishedSubmap copy = taken->freeze(cart, run, finish_reason_);
  finished_.store(nullptr);  // only now may the mapper use it again
  return copy;
}

std::uint64_t SubmapWindow::pool_refusals() const {
  std::uint64_t refused = 0;
  for (const std::unique_ptr<ActiveSubmap>& s : submaps_) refused += s->map().refused() + s->map().surface().refused();
  return refused;
}

std::size_t SubmapWindow::bytes_used() const {
  std::size_t bytes = 0;
  for (const std::unique_ptr<ActiveSubmap>& s : submaps_) bytes += s->map().bytes_used() + s->keyframe_bytes();
  return bytes;
}

std::size_t SubmapWindow::bytes_limit() const {
  std::size_t bytes = 0;
  for (const std::unique_ptr<ActiveSubmap>& s : submaps_) bytes += s->map().bytes_limit() + s->keyframe_bytes();
  return bytes;
}

}  // namespace submapd
