#include "tools/hokuyo_sim/world_ranges.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

constexpr double kRangeMax_m = 30.0;
constexpr double kRangeMin_m = 0.1;
constexpr double kStep_rad = std::numbers::pi / 720.0;
constexpr int kFrontStep = 540;
constexpr double kBeam_ns = 25e6 / 1440.0;
constexpr std::uint32_t kNothing = 1;  // code: nothing in range
constexpr std::uint32_t kTooNear = 4;  // code: too near for the range
constexpr double kNowhere_m = std::numeric_limits<double>::infinity();

// Data sheet: 10 mm up to 10 m, 30 mm at 30 m.
double sigma_m(double range_m) {
  return 0.010 + 0.020 * std::clamp((range_m - 10.0) / 20.0, 0.0, 1.0);
}

}  // namespace

Pose2 pose_at(const Motion& motion, const WorldRangesOptions& options, double true_ns) {
  const double since_s = 1e-9 * (true_ns - static_cast<double>(options.start_ns));
  const double halted_s = std::clamp(since_s - options.halt_s, 0.0, options.halt_for_s);
  return motion.at(since_s - halted_s);
}

WorldRanges::WorldRanges(std::shared_ptr<const World> world, std::shared_ptr<const Motion> motion,
                         WorldRangesOptions options)
    : world_(std::move(world)), motion_(std::move(motion)), options_(options) {}

double WorldRanges::horizontal_m(const Pose2& pose, double angle_rad) const {
  const double yaw = pose.yaw + angle_rad;
  const auto hit = world_->cast(pose.translation(), {std::cos(yaw), std::sin(yaw)}, kRangeMax_m);
  return hit ? hit->range_m : kNowhere_m;
}

double WorldRanges::vertical_m(const Pose2& pose, double angle_rad) const {
  const double aside = std::sin(angle_rad);  // to the left
  const double up = std::cos(angle_rad);
  double range_m = kNowhere_m;
  if (up > 0.0) {
    range_m = (options_.ceiling_m - options_.height_m) / up;
  } else if (up < 0.0) {
    range_m = options_.height_m / -up;
  }
  constexpr double kSteep = 1e-3;  // so steep that floor or ceiling are met before any wall
  if (std::abs(aside) > kSteep) {
    const double yaw = pose.yaw + (aside > 0.0 ? 0.5 : -0.5) * std::numbers::pi;
    const auto wall = world_->cast(pose.translation(), {std::cos(yaw), std::sin(yaw)}, kRangeMax_m);
    if (wall) {
      range_m = std::min(range_m, wall->range_m / std::abs(aside));
    }
  }
  return range_m;
}

void WorldRanges::measure(std::uint64_t rotation, std::int64_t first_beam_ns, std::span<std::uint32_t> range_mm,
                          std::span<std::uint32_t> intensity) {
  for (std::size_t i = 0; i < range_mm.size(); ++i) {
    const double beam_ns = static_cast<double>(first_beam_ns) + kBeam_ns * static_cast<double>(i);
    const Pose2 pose = pose_at(*motion_, options_, beam_ns);
    const double angle_rad = kStep_rad * (static_cast<int>(i) - kFrontStep);
    const double exact_m = options_.vertical ? vertical_m(pose, angle_rad) : horizontal_m(pose, angle_rad);
    intensity[i] = 0;
    if (exact_m > kRangeMax_m) {
      range_mm[i] = kNothing;
      continue;
    }
    CounterRandom random(options_.seed, rotation, i);
    const double range_m = exact_m + sigma_m(exact_m) * random.gaussian();
    range_mm[i] = range_m < kRangeMin_m ? kTooNear : static_cast<std::uint32_t>(std::lround(1000.0 * range_m));
    intensity[i] = static_cast<std::uint32_t>(137.0 + 4000.0 / (1.0 + range_m));
  }
}

}  // namespace submapd::tools
