// Poses of a track that only pass a chain on, taken out of the final solve and put back afterwards.
//
// Two thirds of the key-frames see no landmark: between two that do, they come to one row, the chain's steps
// compounded. Once the ends are solved for, each takes its share of what the chain has to give way.
#pragma once

#include <cstdint>
#include <vector>

#include "slam/base/pose2.hpp"
#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd::graph {

// A row between two poses, before whitening.
struct ChainRow {
  std::uint32_t from = 0;
  std::uint32_t to = 0;
  Pose2 measurement;  // from⁻¹ ∘ to
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

class TrackChains {
 public:
  // `rows` must outlive this. `needed`: by pose, whether other rows than these know it; the first pose is always kept,
  // and so is whatever is not between exactly two rows, one that leads to it and one that leads on.
  TrackChains(const std::vector<ChainRow>& rows, std::vector<bool> needed);

  [[nodiscard]] bool is_kept(std::uint32_t pose) const { return kept_[pose]; }
  // Between kept poses, each a row as it was or a compounded one.
  [[nodiscard]] std::vector<ChainRow> rows() const;
  // Sets the poses that are not kept by those that are.
  void place_others(std::vector<Pose2>& poses) const;

 private:
  // Rows that follow each other from a kept pose to the next one.
  using Chain = std::vector<std::uint32_t>;
  // From the chain's beginning to the end of each of its rows.
  [[nodiscard]] std::vector<UncertainPose> sums_of(const Chain& chain) const;

  const std::vector<ChainRow>& rows_;
  std::vector<bool> kept_;
  std::vector<Chain> chains_;
};

}  // namespace submapd::graph
