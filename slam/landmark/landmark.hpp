// Virtual landmarks l_j and their observations z_ij from track points (paper 2.1.2, equations (5) and (9)).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slam/base/pose2.hpp"

namespace submapd {

// A well-seen spot common to the sub-maps a and b. Observations are kept as the key-frames that make them: the rest
// follows from where the spot lies in the sub-map (observation_of()).
struct VirtualLandmark {
  std::uint32_t a = 0;  // the pair it was chosen for, a < b
  std::uint32_t b = 0;
  Eigen::Vector2d in_a = Eigen::Vector2d::Zero();              // m, in a's frame
  Eigen::Vector2d in_b = Eigen::Vector2d::Zero();              // m, in b's frame, as refined against b's own map
  Eigen::Matrix2d covariance_a = Eigen::Matrix2d::Identity();  // of in_a as a's map shows it, a's frame, m^2
  Eigen::Matrix2d covariance_b = Eigen::Matrix2d::Identity();  // of in_b, b's frame, m^2
  std::vector<std::uint32_t> seen_from_a;                      // a's key-frames that see it, ascending, at least one
  std::vector<std::uint32_t> seen_from_b;                      // the same of b
};

// z_ij: where track point i sees landmark j.
struct LandmarkObservation {
  Eigen::Vector2d z = Eigen::Vector2d::Zero();               // in the track point's frame, m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();  // in the track point's frame, m^2
};

// What a key-frame at `submap_from_keyframe` sees of a spot that the sub-map's own map shows at `place` +-
// `covariance`.
[[nodiscard]] inline LandmarkObservation observation_of(const Eigen::Vector2d& place, const Eigen::Matrix2d& covariance,
                                                        const Pose2& submap_from_keyframe) {
  const Eigen::Matrix2d to_keyframe = rotation(submap_from_keyframe.yaw).transpose();
  return {to_keyframe * (place - submap_from_keyframe.translation()),
          to_keyframe * covariance * to_keyframe.transpose()};
}

}  // namespace submapd
