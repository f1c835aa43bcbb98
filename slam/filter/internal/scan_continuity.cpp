#include "slam/filter/internal/scan_continuity.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

// The motion between the two is known as well as the last one was.
constexpr float kSlack_m = 0.1F;
constexpr float kSlackPerRange = 0.03F;

}  // namespace

// By the place on a square about the sensor instead of the angle: as monotone, and without an arctangent a beam.
int ScanContinuity::bin_of(float x, float y) {
  const float norm = std::abs(x) + std::abs(y);
  if (norm == 0.0F) return 0;
  const float side = x >= 0.0F ? y / norm : 2.0F - y / norm;  // [-1, 3]
  return std::clamp(static_cast<int>((side + 1.0F) * (kBins / 4.0F)), 0, kBins - 1);
}

void ScanContinuity::keep(const ScanPoints& scan) {
  origin_ = scan.origin();
  reach_.fill({});
  for (const ScanPoint& p : scan.all()) {
    Reach& reach = reach_[static_cast<std::size_t>(bin_of(p.x - origin_.x(), p.y - origin_.y()))];
    reach.nearest_m = std::min(reach.nearest_m, p.range_m);
    reach.farthest_m = std::max(reach.farthest_m, p.range_m);
  }
}

ScanContinuity::Change ScanContinuity::compare(const ScanPoints& now, const Pose2& before_from_now) const {
  Change change;
  const auto c = static_cast<float>(std::cos(before_from_now.yaw));
  const auto s = static_cast<float>(std::sin(before_from_now.yaw));
  const Eigen::Vector2f shift = before_from_now.translation().cast<float>() - origin_;
  int same = 0;
  int farther = 0;
  for (const ScanPoint& p : now.thinned()) {
    const float x = c * p.x - s * p.y + shift.x();
    const float y = s * p.x + c * p.y + shift.y();
    const int bin = bin_of(x, y);
    Reach seen;
    for (const int k : {bin + kBins - 1, bin, bin + 1}) {
      const Reach& beside = reach_[static_cast<std::size_t>(k % kBins)];
      seen.nearest_m = std::min(seen.nearest_m, beside.nearest_m);
      seen.farthest_m = std::max(seen.farthest_m, beside.farthest_m);
    }
    if (seen.farthest_m == 0.0F) continue;
    ++change.compared;
    const float range_m = std::hypot(x, y);
    const float slack_m = kSlack_m + kSlackPerRange * range_m;
    if (range_m > seen.farthest_m + slack_m) {
      ++farther;
    } else if (range_m >= seen.nearest_m - slack_m) {
      ++same;
    }
  }
  if (change.compared == 0) return change;
  change.same = static_cast<double>(same) / change.compared;
  change.farther = static_cast<double>(farther) / change.compared;
  return change;
}

}  // namespace submapd
