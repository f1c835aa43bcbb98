// The optimised pose of every scan, in order of time: what trajectory.tum, marks and cloud are made of.
//
// Each scan's pose was spooled relative to its key-frame and follows the optimised key-frame; what the optimisation
// changed between two key-frames is spread over the scans between them. One thread; reads the spool from the disk.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <unordered_map>
#include <vector>

#include "slam/graph/optimizer.hpp"
#include "slam/output/pose_spool.hpp"

namespace submapd {

class OptimizedTrajectory {
 public:
  // Of the first `scans` of the spool; the key-frame of each must be part of the result. All must outlive the object.
  // Errors: kIo.
  [[nodiscard]] static Expected<OptimizedTrajectory> make(const FinalResult& result, const PoseSpool& poses,
                                                          std::uint64_t scans);

  using Visit = std::function<Status(const SpooledPose& spooled, const Pose2& map_from_base)>;
  // Until `visit` returns an error. Errors: its, kIo, kInternal (a key-frame without an optimised pose).
  [[nodiscard]] Status for_each(const Visit& visit) const;

 private:
  OptimizedTrajectory(const FinalResult& result, const PoseSpool& poses, std::uint64_t scans);
  void note_step(const SpooledPose& pose);
  [[nodiscard]] std::optional<Pose2> pose_of(const SpooledPose& pose) const;

  const std::vector<OptimizedKeyframe>* keyframes_;
  const PoseSpool* poses_;
  std::uint64_t scans_;
  std::vector<Pose2> misfit_;  // from key-frame i to i + 1
  std::unordered_map<std::uint64_t, std::size_t> position_;
};

}  // namespace submapd
