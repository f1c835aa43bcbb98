// A cart's run as the optimizer sees it, with known truth, and a matcher that knows it too and can be made to lie.
//
// Key-frames every 0.3 m along a path; a new sub-map each 10 m, each 20 m long: neighbours share half their key-frames,
// with the very same poses, as in our front end. What is tracked drifts; what is matched has the noise it claims.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/submap/finished_submap.hpp"
#include "slam/submap/submap_source.hpp"

namespace submapd::testing {

struct SimulatedRunOptions {
  std::uint64_t seed = 1;
  double step_sigma_m = 0.002;        // of each key-frame step, as in its covariance
  double step_sigma_rad = 0.0009;     // 0.05 deg
  double match_noise = 1.0;           // 0: exact matches and landmarks; 1: 2 cm and 0.1 deg, 1 cm
  double false_loops = 0.0;           // share of searches that answer with a wrong place, as well scored as a right one
  double failures = 0.0;              // share of searches that find nothing
  std::vector<std::uint32_t> breaks;  // sub-maps that are not linked to the previous one
};

// Ring of `circumference_m`, `laps` times round, starting at the origin and going along x.
[[nodiscard]] std::vector<Pose2> ring_path(double circumference_m, double laps);
// Straight there along x and back beside it.
[[nodiscard]] std::vector<Pose2> corridor_path(double length_m);

class SimulatedRun : public SubmapSource {
 public:
  SimulatedRun(const std::vector<Pose2>& path, const SimulatedRunOptions& options);

  Expected<std::shared_ptr<const FinishedSubmap>> load(std::uint32_t index) override;
  [[nodiscard]] PairTools tools() const;
  [[nodiscard]] const std::vector<std::shared_ptr<const FinishedSubmap>>& submaps() const { return submaps_; }

  [[nodiscard]] Pose2 truth_of_submap(std::uint32_t index) const { return truth_[first_[index]]; }
  [[nodiscard]] const std::vector<Pose2>& truth() const { return truth_; }   // by scan_index
  [[nodiscard]] const std::vector<Pose2>& tracked() const { return odom_; }  // by scan_index

  // Whether the match says where b lies to within what the noise allows.
  [[nodiscard]] bool is_true(const SubmapMatch& match) const;

  [[nodiscard]] SubmapMatch search(const FinishedSubmap& a, const FinishedSubmap& b, const MatchPrior& prior) const;
  [[nodiscard]] SubmapMatch refine(const FinishedSubmap& a, const FinishedSubmap& b) const;
  [[nodiscard]] std::vector<VirtualLandmark> landmarks(const FinishedSubmap& a, const FinishedSubmap& b,
                                                       const SubmapMatch& match) const;

 private:
  [[nodiscard]] Eigen::Vector2d middle(std::uint32_t a, std::uint32_t b) const;
  [[nodiscard]] std::size_t nearest_keyframe(const FinishedSubmap& submap, const Eigen::Vector2d& place) const;
  [[nodiscard]] Pose2 true_relative(const FinishedSubmap& a, const FinishedSubmap& b) const;
  [[nodiscard]] double true_overlap_m2(const FinishedSubmap& a, const FinishedSubmap& b) const;

  SimulatedRunOptions options_;
  std::vector<Pose2> truth_;
  std::vector<Pose2> odom_;
  std::vector<std::size_t> first_;  // of each sub-map
  std::vector<std::shared_ptr<const FinishedSubmap>> submaps_;
};

// Root mean square distance of sub-map origins from the truth, first one taken as given.
[[nodiscard]] double rmse_m(const SimulatedRun& run, const std::vector<SubmapPose>& submaps);
[[nodiscard]] double rmse_m(const SimulatedRun& run, const std::vector<OptimizedKeyframe>& keyframes);

}  // namespace submapd::testing
