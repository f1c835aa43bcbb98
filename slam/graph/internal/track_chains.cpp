#include "slam/graph/internal/track_chains.hpp"

#include <limits>
#include <utility>

#include "slam/base/small_matrix.hpp"
#include "slam/graph/internal/least_squares.hpp"

namespace submapd::graph {
namespace {

constexpr double kVague_rad2 = 0.05 * 0.05;  // first order holds up to there
constexpr double kVague_m2 = 1.0;
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

UncertainPose step_of(const ChainRow& row) {
  return {row.measurement, row.covariance};
}

}  // namespace

TrackChains::TrackChains(const std::vector<ChainRow>& rows, std::vector<bool> needed)
    : rows_(rows), kept_(std::move(needed)) {
  std::vector<std::uint32_t> onward(kept_.size(), kNone);  // by pose: the row that leads on from it
  std::vector<bool> reached(kept_.size(), false);
  kept_[0] = true;
  for (std::uint32_t k = 0; k < rows.size(); ++k) {
    const ChainRow& row = rows[k];
    if (onward[row.from] != kNone) kept_[row.from] = true;
    if (reached[row.to]) kept_[row.to] = true;
    // What cannot be compounded stays a row by itself: across a break of the track the far end swings by radians.
    const bool vague = row.covariance(2, 2) > kVague_rad2 || row.covariance.topLeftCorner<2, 2>().trace() > kVague_m2;
    if (row.from >= row.to || vague || !whitening(row.covariance)) kept_[row.from] = kept_[row.to] = true;
    onward[row.from] = k;
    reached[row.to] = true;
  }
  for (std::uint32_t pose = 0; pose < kept_.size(); ++pose) {
    if (onward[pose] == kNone || !reached[pose]) kept_[pose] = true;
  }
  for (std::uint32_t k = 0; k < rows.size(); ++k) {
    if (!kept_[rows[k].from]) continue;
    Chain chain{k};
    while (!kept_[rows[chain.back()].to]) chain.push_back(onward[rows[chain.back()].to]);
    chains_.push_back(std::move(chain));
  }
}

std::vector<UncertainPose> TrackChains::sums_of(const Chain& chain) const {
  std::vector<UncertainPose> sums{step_of(rows_[chain.front()])};
  for (std::size_t i = 1; i < chain.size(); ++i) sums.push_back(compose(sums.back(), step_of(rows_[chain[i]])));
  return sums;
}

std::vector<ChainRow> TrackChains::rows() const {
  std::vector<ChainRow> compounded;
  for (const Chain& chain : chains_) {
    const UncertainPose whole = sums_of(chain).back();
    compounded.push_back({rows_[chain.front()].from, rows_[chain.back()].to, whole.mean, whole.covariance});
  }
  return compounded;
}

// The expectation of each pose given both ends: its covariance with the far end's error times that error.
void TrackChains::place_others(std::vector<Pose2>& poses) const {
  for (const Chain& chain : chains_) {
    if (chain.size() < 2) continue;
    const std::vector<UncertainPose> sums = sums_of(chain);
    const UncertainPose& whole = sums.back();
    const Pose2& start = poses[rows_[chain.front()].from];
    const Pose2 end = between(start, poses[rows_[chain.back()].to]);
    const Eigen::Vector3d off(end.x - whole.mean.x, end.y - whole.mean.y, wrap_angle(end.yaw - whole.mean.yaw));
    const Eigen::Vector3d pull = solve_definite(whole.covariance, off);
    for (std::size_t i = 0; i + 1 < chain.size(); ++i) {
      const UncertainPose& here = sums[i];
      Eigen::Matrix3d end_by_here = Eigen::Matrix3d::Identity();
      end_by_here(0, 2) = here.mean.y - whole.mean.y;
      end_by_here(1, 2) = whole.mean.x - here.mean.x;
      const Eigen::Vector3d give = here.covariance * (end_by_here.transpose() * pull);
      poses[rows_[chain[i]].to] =
          compose(start, {here.mean.x + give.x(), here.mean.y + give.y(), here.mean.yaw + give.z()});
    }
  }
}

}  // namespace submapd::graph
