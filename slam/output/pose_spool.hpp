// Poses of every scan, kept on disk while a run lasts: eight hours at 40 Hz are no reason to hold them in memory.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd {

// One scan's pose relative to the newest key-frame, so that it stays true when key-frames are optimised.
struct SpooledPose {
  std::int64_t stamp_us = 0;
  std::uint64_t keyframe_scan_index = 0;
  Pose2 keyframe_from_base;
  // For a key-frame itself: its pose seen from the key-frame before it; `linked` false after a break.
  Pose2 previous_keyframe_from_base;
  bool keyframe = false;
  bool linked = false;
};

// The file has no name: it is gone with the object, however the process ends. One thread adds, others may read what is
// there at the same time.
class PoseSpool {
 public:
  // The file lies in `folder`, which must exist.
  [[nodiscard]] static Expected<std::unique_ptr<PoseSpool>> create(const std::filesystem::path& folder);
  PoseSpool(const PoseSpool&) = delete;
  PoseSpool& operator=(const PoseSpool&) = delete;
  ~PoseSpool();

  Status add(const SpooledPose& pose);
  // Calls `visit` for the first `count` records in order, until it returns an error. REQUIRES: count <= size().
  Status for_each(std::uint64_t count, const std::function<Status(const SpooledPose&)>& visit) const;
  [[nodiscard]] std::uint64_t size() const { return size_.load(std::memory_order_acquire); }

 private:
  explicit PoseSpool(int fd) : fd_(fd) {}

  const int fd_;
  std::atomic<std::uint64_t> size_{0};
};

}  // namespace submapd
