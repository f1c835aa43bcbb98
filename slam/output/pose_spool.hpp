// Poses of every scan, kept on disk: eight hours at 40 Hz are no reason to hold them in memory.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <string_view>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd {

// A file of poses begins with this, and has records of this size.
inline constexpr std::string_view kPoseSpoolMagic = "SMAPPOSE";
inline constexpr std::size_t kPoseRecordBytes = 8 + 8 + 6 * 8 + 4 + 4;

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

// A run's file is `poses` (pose-spool-format.md) and outlives the process; replay's has no name and is gone with the
// object. One thread adds, others may read what is there at the same time.
class PoseSpool {
 public:
  // A file without a name in `folder`, which must exist.
  [[nodiscard]] static Expected<std::unique_ptr<PoseSpool>> create(const std::filesystem::path& folder);
  // The file `path`, made if it is missing. What it holds is kept up to the first record that is damaged or cut off;
  // the rest is cut away. Errors: kIo, kCorrupt (no such file of ours).
  [[nodiscard]] static Expected<std::unique_ptr<PoseSpool>> open(const std::filesystem::path& path);
  PoseSpool(const PoseSpool&) = delete;
  PoseSpool& operator=(const PoseSpool&) = delete;
  ~PoseSpool();

  // After an error the file ends with the last whole record.
  Status add(const SpooledPose& pose);
  // Cuts away what is stamped later. The adding thread's, while nobody reads.
  Status keep_until(std::int64_t until_us);
  // What was added is on the disk.
  Status sync();
  // Calls `visit` for the first `count` records in order, until it returns an error. REQUIRES: count <= size().
  Status for_each(std::uint64_t count, const std::function<Status(const SpooledPose&)>& visit) const;
  [[nodiscard]] std::uint64_t size() const { return size_.load(std::memory_order_acquire); }
  // Of the newest record; the least number there is if there is none. The adding thread's.
  [[nodiscard]] std::int64_t last_stamp_us() const { return last_stamp_us_; }

 private:
  explicit PoseSpool(int fd) : fd_(fd) {}
  Status begin_file();
  Status check_header() const;

  const int fd_;
  std::atomic<std::uint64_t> size_{0};
  std::int64_t last_stamp_us_ = std::numeric_limits<std::int64_t>::min();
};

// The records of a file of poses, checked: how many are whole, and how many bytes that is; for submapctl verify.
struct PoseSpoolCheck {
  std::uint64_t records = 0;
  std::size_t whole_bytes = 0;
};
// kCorrupt: no file of poses, or another version.
[[nodiscard]] Expected<PoseSpoolCheck> check_pose_spool(std::span<const std::byte> bytes);

}  // namespace submapd
