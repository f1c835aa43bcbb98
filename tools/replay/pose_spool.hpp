// Poses of every scan, kept on disk while a run lasts: eight hours at 40 Hz are no reason to hold them in memory.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"

namespace submapd::tools {

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

// Write all, then read any number of times. The file has no name: it is gone with the object, however the process ends.
class PoseSpool {
 public:
  // The file lies in `folder`, which must exist.
  [[nodiscard]] static Expected<std::unique_ptr<PoseSpool>> create(const std::filesystem::path& folder);

  Status add(const SpooledPose& pose);
  // Calls `visit` for each record in order, until it returns an error.
  Status for_each(const std::function<Status(const SpooledPose&)>& visit);
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  struct Closer {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  explicit PoseSpool(std::FILE* file) : file_(file) {}

  std::unique_ptr<std::FILE, Closer> file_;
  std::uint64_t size_ = 0;
};

}  // namespace submapd::tools
