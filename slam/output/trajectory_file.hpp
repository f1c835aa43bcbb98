// Trajectories in the TUM format: one line "timestamp x y z qx qy qz qw" a pose, metres and unit quaternion, planar.
//
// The timestamp is stamp_us as seconds with six decimals, exact. Poses are of `base` at the scan's first beam.
#pragma once

#include <cstdint>
#include <filesystem>
#include <iosfwd>
#include <string>
#include <string_view>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "slam/output/internal/text_file.hpp"

namespace submapd {

struct StampedPose {
  std::int64_t stamp_us = 0;
  Pose2 pose;
  friend bool operator==(const StampedPose&, const StampedPose&) = default;
};

// Writes line by line in constant memory; the file appears at commit(). One thread; blocks on the disk.
class TrajectoryFile {
 public:
  explicit TrajectoryFile(const std::filesystem::path& path) : file_(path) {}

  // Positions keep 1 um, the yaw 1e-8 rad. Refuses a pose that is not finite and stays usable.
  Status add(std::int64_t stamp_us, const Pose2& pose);
  // Makes the file appear. Call at most once.
  Status commit() { return file_.commit(); }

 private:
  internal::TextFile file_;
};

// Seconds with six decimals, without going through a double: 1500000 -> "1.500000".
[[nodiscard]] std::string seconds_text(std::int64_t stamp_us);

// Reads a TUM file into memory; blank lines and '#' comments are skipped, z, qx and qy must be numbers and are dropped.
// The yaw comes back in [-pi, pi). An error names the line.
[[nodiscard]] Expected<std::vector<StampedPose>> read_tum(const std::filesystem::path& path);
// The same from a stream; `name` is for messages.
[[nodiscard]] Expected<std::vector<StampedPose>> read_tum(std::istream& in, std::string_view name);

}  // namespace submapd
