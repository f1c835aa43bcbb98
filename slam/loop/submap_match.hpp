// The result of matching two sub-maps: where b lies in a's frame, how sure that is, and every figure it was judged by.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "slam/base/pose2.hpp"

namespace submapd {

// Why a candidate was refused (design notes 9.2), or that it was not.
enum class MatchVerdict : std::uint8_t {
  kAccepted,
  kNoPeak,  // branch and bound found nothing above the score threshold
  kLowScore,
  kSmallOverlap,
  kContradiction,  // one has looked through what the other holds occupied
  kAmbiguous,      // a second peak nearly as good
  kAsymmetric,     // a on b and b on a disagree
  kGate,           // too far from the prior for its covariance
};

struct SubmapMatch {
  std::uint32_t a = 0;  // sub-map indices within the run, a < b
  std::uint32_t b = 0;
  Pose2 a_from_b;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of a_from_b's (x, y, yaw), in a's frame
  double score = 0.0;                                    // share of overlapping surface points that fit, [0, 1]
  double overlap_m2 = 0.0;                               // area known to both
  double overlap_share = 0.0;                            // of the smaller sub-map's known area
  double contradiction = 0.0;  // share of occupied cells the other saw as free, both directions
  double second_peak = 0.0;    // score of the best distinct placement relative to the best; 0: none above the limit
  bool weak = false;           // one direction is poorly constrained; its covariance says so
  MatchVerdict verdict = MatchVerdict::kNoPeak;
};

}  // namespace submapd
