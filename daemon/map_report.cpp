#include "daemon/map_report.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace submapd {
namespace {

constexpr std::size_t kMostResiduals = 100;

nlohmann::json loops_of(const RunQuality& quality, const FinalResult& result) {
  const auto count = [&](LoopState state) {
    return std::count_if(result.loops.begin(), result.loops.end(),
                         [state](const Loop& loop) { return loop.state == state; });
  };
  std::vector<LoopResidual> worst = quality.loops;
  std::stable_sort(worst.begin(), worst.end(),
                   [](const LoopResidual& a, const LoopResidual& b) { return a.distance_m > b.distance_m; });
  nlohmann::json residuals = nlohmann::json::array();
  for (const LoopResidual& loop : worst) {
    if (residuals.size() == kMostResiduals) break;
    residuals.push_back({{"a", loop.a},
                         {"b", loop.b},
                         {"distance_m", loop.distance_m},
                         {"turn_rad", loop.turn_rad},
                         {"sigmas", loop.sigmas},
                         {"contradiction", loop.contradiction}});
  }
  return {{"confirmed", count(LoopState::kConfirmed)},
          {"pending", count(LoopState::kPending)},
          {"rejected", count(LoopState::kRejected)},
          {"residuals", residuals}};
}

}  // namespace

nlohmann::json quality_report(const RunQuality& quality, const FinalResult& result) {
  double sigma_m = 0.0;
  for (const SubmapBound& bound : result.bounds) {
    sigma_m = std::max(sigma_m, std::sqrt(std::max(bound.covariance(0, 0), bound.covariance(1, 1))));
  }
  const auto keyframes = static_cast<double>(std::max<std::uint64_t>(1, quality.keyframes));
  return {{"format", 1},
          {"walls",
           {{"pieces", quality.wall_pieces},
            {"sigma_p50_m", quality.wall_sigma_p50_m},
            {"sigma_p95_m", quality.wall_sigma_p95_m}}},
          {"map",
           {{"free_m2", quality.free_m2},
            {"occupied_m2", quality.occupied_m2},
            {"undecided_share", quality.undecided_share}}},
          {"loops", loops_of(quality, result)},
          {"bend_m", quality.bend_m},
          {"sigma_bound_m", sigma_m},
          {"degenerate_share", static_cast<double>(quality.keyframes_degenerate) / keyframes},
          {"breaks", quality.breaks}};
}

}  // namespace submapd
