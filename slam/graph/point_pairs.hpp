// The relative pose of two sub-maps from spots that somebody found in both: closed form (design notes, section 12).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd {

inline constexpr double kLeastBaseline_m = 1.0;  // between the two spots of a tie that are farthest apart

struct PointPairPose {
  Pose2 a_from_b;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of (x, y, yaw) in a's frame, for the sigma that was given
  std::vector<double> residual_m;                        // a pair each
};

// The rigid motion that carries the spots of b onto those of a with the least squares: with a and b centred,
// yaw = atan2(sum a x b, sum a . b) (Horn 1987 in the plane). `sigma_m`: of a spot in either sub-map, a side.
// Errors: kInvalidArgument (fewer than two pairs, not finite, or nearer together than kLeastBaseline_m).
[[nodiscard]] Expected<PointPairPose> relative_pose_of(const std::vector<TiePoint>& points, double sigma_m);

}  // namespace submapd
