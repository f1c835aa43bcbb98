// Virtual landmarks l_j and their observations z_ij from track points (paper 2.1.2, equations (5) and (9)).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace submapd {

// z_ij: where track point i sees landmark j, in the track point's frame.
struct LandmarkObservation {
  std::uint32_t submap = 0;                     // index of the sub-map through whose map the landmark was seen
  std::uint32_t keyframe = 0;                   // index into that sub-map's keyframes
  Eigen::Vector2d z = Eigen::Vector2d::Zero();  // m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();  // m^2, in the track point's frame; already inflated so
                                                             // that the rows of one side count once, not m times
};

// A well-seen spot common to the sub-maps a and b, tied to both by its observations.
struct VirtualLandmark {
  std::uint32_t a = 0;  // the pair it was chosen for, a < b
  std::uint32_t b = 0;
  Eigen::Vector2d in_a = Eigen::Vector2d::Zero();              // m, in a's frame
  Eigen::Vector2d in_b = Eigen::Vector2d::Zero();              // m, in b's frame, as refined against b's own map
  Eigen::Matrix2d covariance_a = Eigen::Matrix2d::Identity();  // of in_a as a's map shows it, a's frame, m^2
  Eigen::Matrix2d covariance_b = Eigen::Matrix2d::Identity();  // of in_b, b's frame, m^2
  std::vector<LandmarkObservation> observations;               // from key-frames of a and of b, at least one each
};

}  // namespace submapd
