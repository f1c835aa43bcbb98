#include "slam/output/run_quality.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd {
namespace {

constexpr double kLikelyFree = 0.2;
constexpr double kLikelyOccupied = 0.8;

}  // namespace

void QualityCollector::note_submap(const FinishedSubmap& submap) {
  for (const SurfacePoint& point : submap.surface) {
    if (point.normal_x == 0.0F && point.normal_y == 0.0F) continue;
    const auto bin = static_cast<std::size_t>(std::max(0.0, static_cast<double>(point.sigma_m) / kBin_m));
    ++sigmas_[std::min(bin, sigmas_.size() - 1)];
    ++quality_.wall_pieces;
  }
  for (const Keyframe& keyframe : submap.keyframes) {
    ++quality_.keyframes;
    quality_.keyframes_degenerate += keyframe.degenerate ? 1 : 0;
  }
  if (submap.id.index > 0 && !submap.linked_to_previous) ++quality_.breaks;
}

void QualityCollector::note_pose(const SpooledPose& spooled, const Pose2& map_from_base) {
  if (!spooled.keyframe) return;
  filter_ = filter_ && spooled.linked ? compose(*filter_, spooled.previous_keyframe_from_base) : map_from_base;
  quality_.bend_m = std::max(quality_.bend_m, (filter_->translation() - map_from_base.translation()).norm());
}

double QualityCollector::sigma_at(double share) const {
  const double wanted = share * static_cast<double>(quality_.wall_pieces);
  double sum = 0.0;
  for (std::size_t bin = 0; bin < sigmas_.size(); ++bin) {
    sum += static_cast<double>(sigmas_[bin]);
    if (sum >= wanted && sum > 0.0) return kBin_m * (static_cast<double>(bin) + 0.5);
  }
  return 0.0;
}

RunQuality QualityCollector::result(const MapImage& map, const FinalResult& final_result) const {
  RunQuality quality = quality_;
  quality.wall_sigma_p50_m = sigma_at(0.50);
  quality.wall_sigma_p95_m = sigma_at(0.95);
  std::uint64_t free = 0;
  std::uint64_t occupied = 0;
  std::uint64_t undecided = 0;
  for (const std::uint8_t cell : map.cells) {
    if (cell == 0) continue;
    const double p = occupancy_of(cell);
    ++(p <= kLikelyFree ? free : p >= kLikelyOccupied ? occupied : undecided);
  }
  const double cell_m2 = map.cell_m * map.cell_m;
  quality.free_m2 = cell_m2 * static_cast<double>(free);
  quality.occupied_m2 = cell_m2 * static_cast<double>(occupied);
  const std::uint64_t seen = free + occupied + undecided;
  if (seen > 0) quality.undecided_share = static_cast<double>(undecided) / static_cast<double>(seen);

  std::unordered_map<std::uint32_t, Pose2> origins;
  for (const SubmapPose& submap : final_result.submaps) origins[submap.index] = submap.map_from_submap;
  for (const Loop& loop : final_result.loops) {
    if (loop.state != LoopState::kConfirmed) continue;
    const SubmapMatch& match = loop.match;
    const Pose2 optimised = between(origins[match.a], origins[match.b]);
    const Pose2 off{optimised.x - match.a_from_b.x, optimised.y - match.a_from_b.y,
                    wrap_angle(optimised.yaw - match.a_from_b.yaw)};
    quality.loops.push_back({match.a, match.b, off.translation().norm(), std::abs(off.yaw),
                             std::sqrt(graph::mahalanobis2(off, match.covariance)), match.contradiction});
  }
  return quality;
}

}  // namespace submapd
