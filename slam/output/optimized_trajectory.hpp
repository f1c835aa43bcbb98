// The optimised pose of every scan, in order of time: what trajectory.tum, marks and cloud are made of.
//
// Each scan's pose was spooled relative to its key-frame and follows the optimised key-frame. Key-frames that have no
// optimised pose of their own (those of condensed sub-maps but one) follow the newest one that has, by the
// filter's own steps. What the optimisation changed between two optimised key-frames is spread over the scans between
// them. One thread; reads the spool from the disk.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "slam/graph/optimizer.hpp"
#include "slam/output/pose_spool.hpp"

namespace submapd {

class OptimizedTrajectory {
 public:
  // Of the first `scans` of the spool; the key-frame of each must be part of the result, or follow one that is. All
  // must outlive the object. Errors: kIo.
  [[nodiscard]] static Expected<OptimizedTrajectory> make(const FinalResult& result, const PoseSpool& poses,
                                                          std::uint64_t scans);

  using Visit = std::function<Status(const SpooledPose& spooled, const Pose2& map_from_base)>;
  // Until `visit` returns an error. Left out are scans whose key-frame is not in the spool (a disk that was full) and
  // has no optimised pose. Errors: visit's, kIo, kInternal (a key-frame that follows none that is optimised).
  [[nodiscard]] Status for_each(const Visit& visit) const;

 private:
  // The newest key-frame, as the optimised one before it has it by the filter's steps.
  struct Chain {
    std::optional<std::size_t> anchor;  // into keyframes_
    Pose2 anchor_from_keyframe;
    std::uint64_t keyframe_scan_index = 0;
    bool lost = false;  // a key-frame is missing in the spool, since the last optimised one
  };

  OptimizedTrajectory(const FinalResult& result, const PoseSpool& poses, std::uint64_t scans);
  [[nodiscard]] std::optional<std::size_t> optimised(std::uint64_t scan_index) const;
  // To the key-frame of `pose`, which is its own or, if that was not spooled, that of a later scan.
  void advance(Chain& chain, const SpooledPose& pose) const;
  void note_step(const Chain& before, const SpooledPose& pose);
  [[nodiscard]] std::optional<Pose2> pose_of(const Chain& chain, const SpooledPose& pose) const;

  const std::vector<OptimizedKeyframe>* keyframes_;
  const PoseSpool* poses_;
  std::uint64_t scans_;
  std::vector<Pose2> misfit_;  // from key-frame i to i + 1
};

}  // namespace submapd
