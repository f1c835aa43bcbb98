#include "slam/landmark/landmark_observations.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace submapd {
namespace {

constexpr double kBeamNear_m = 0.15;
constexpr std::size_t kFewestUnshared = 2;  // with fewer, shared key-frames fill up
// Every so many key-frames of a sub-map are its regular observers; where too few of those see a spot, every half as
// many, and so on. The fewer key-frames the landmarks tie together, the less fill the final solve has, and between
// neighbours the steps are far surer than a landmark.
constexpr std::uint32_t kRegularStride = 32;

// Bearings a beam that ends near the spot can have: the spot's size, plus what the cart turns during the sweep.
double bearing_margin(const Keyframe& keyframe, double range_m) {
  const double moved_m = keyframe.geometry.sweep_s * std::hypot(keyframe.twist.vx, keyframe.twist.vy);
  const double turned = keyframe.geometry.sweep_s * std::abs(keyframe.twist.wz);
  return std::atan2(kBeamNear_m + moved_m, range_m) + turned + std::abs(keyframe.geometry.angle_step_rad);
}

// `count` of the submap's key-frames for which `observes` holds, or of its regular ones among them if they suffice,
// evenly spread, first and last included where there are two. Asks about no more key-frames than it needs.
template <typename Observes>
std::vector<std::uint32_t> spread(std::size_t keyframes, std::size_t count, const Observes& observes) {
  std::vector<std::uint32_t> from;
  for (std::uint32_t stride = kRegularStride; stride > 0 && from.size() < kFewestUnshared; stride /= 2) {
    for (std::uint32_t keyframe = 0; keyframe < keyframes; keyframe += stride) {
      const bool asked = stride != kRegularStride && keyframe % (2 * stride) == 0;
      if (!asked && observes(keyframe)) {
        from.push_back(keyframe);
      }
    }
  }
  std::sort(from.begin(), from.end());
  if (from.size() <= count) {
    return from;
  }
  std::vector<std::uint32_t> chosen;
  for (std::size_t i = 0; i < count; ++i) {
    chosen.push_back(count == 1 ? from[from.size() / 2] : from[i * (from.size() - 1) / (count - 1)]);
  }
  return chosen;
}

}  // namespace

bool has_scan(const FinishedSubmap& submap, std::uint64_t scan_index) {
  const auto place = std::lower_bound(submap.keyframes.begin(), submap.keyframes.end(), scan_index,
                                      [](const Keyframe& k, std::uint64_t index) { return k.scan_index < index; });
  return place != submap.keyframes.end() && place->scan_index == scan_index;
}

bool sees(const Keyframe& keyframe, const Eigen::Vector2d& place, double max_range_m) {
  const ScanGeometry& geometry = keyframe.geometry;
  const Eigen::Vector2d in_base = transform(inverse(keyframe.pose), place);
  const Eigen::Vector2d in_sensor = transform(inverse(geometry.base_from_sensor), in_base);
  const double range = in_sensor.norm();
  if (range > max_range_m || range < geometry.range_min_m || keyframe.ranges_mm.empty() ||
      geometry.angle_step_rad == 0.0) {
    return false;
  }
  const double last_beam = static_cast<double>(keyframe.ranges_mm.size() - 1);
  const double tau_step = last_beam > 0.0 ? geometry.sweep_s / last_beam : 0.0;
  const double bearing = std::atan2(in_sensor.y(), in_sensor.x());
  const double margin = bearing_margin(keyframe, range);
  // The sweep may cross +-180 deg: try the bearing a turn either way too.
  for (int turn = -1; turn <= 1; ++turn) {
    const double middle =
        (bearing + 2.0 * std::numbers::pi * turn - geometry.first_angle_rad) / geometry.angle_step_rad;
    const double reach = margin / std::abs(geometry.angle_step_rad);
    const double first = std::max(0.0, std::ceil(middle - reach));
    const double last = std::min(last_beam, std::floor(middle + reach));
    for (double beam = first; beam <= last; beam += 1.0) {
      const double measured = 1e-3 * keyframe.ranges_mm[static_cast<std::size_t>(beam)];
      // Moving during the sweep changes a range by less than the margin below; the exact test follows.
      if (measured < geometry.range_min_m || measured > geometry.range_max_m || std::abs(measured - range) > 0.5) {
        continue;
      }
      const double angle = geometry.first_angle_rad + beam * geometry.angle_step_rad;
      const Eigen::Vector2d end = measured * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      const Pose2 base_at_beam = exp_twist(keyframe.twist, beam * tau_step);
      if ((transform(base_at_beam, transform(geometry.base_from_sensor, end)) - in_base).norm() <= kBeamNear_m) {
        return true;
      }
    }
  }
  return false;
}

std::vector<std::uint32_t> observers_of(const Eigen::Vector2d& place, const FinishedSubmap& submap,
                                        const FinishedSubmap& other, int count, double max_range_m) {
  const auto observers = [&](bool shared, std::size_t wanted) {
    return spread(submap.keyframes.size(), wanted, [&](std::uint32_t i) {
      const Keyframe& keyframe = submap.keyframes[i];
      return has_scan(other, keyframe.scan_index) == shared && sees(keyframe, place, max_range_m);
    });
  };
  const auto wanted = static_cast<std::size_t>(std::max(1, count));
  std::vector<std::uint32_t> chosen = observers(false, wanted);
  if (chosen.size() < kFewestUnshared) {
    const std::vector<std::uint32_t> more = observers(true, wanted - std::min(wanted, chosen.size()));
    chosen.insert(chosen.end(), more.begin(), more.end());
    std::sort(chosen.begin(), chosen.end());
  }
  chosen.shrink_to_fit();
  return chosen;
}

}  // namespace submapd
