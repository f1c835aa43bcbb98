#include "tools/sim/simulator.hpp"

#include <algorithm>
#include <cmath>

#include "slam/base/random.hpp"
#include "tools/sim/beam.hpp"

namespace submapd::tools {
namespace {

// Random streams of one seed; scans use theirs with the number of the beam.
constexpr std::uint64_t kBeamStream = 0x4245414D00000000;
constexpr std::uint64_t kSurfaceStream = 0x474C415300000000;
constexpr std::uint64_t kOdometryStream = 0x4F444F4D;
constexpr std::uint64_t kOdometryScaleStream = 0x5343414C;

}  // namespace

Simulator::Simulator(std::shared_ptr<const World> world, std::shared_ptr<const Motion> motion,
                     const SimulatorOptions& options)
    : world_(std::move(world)), motion_(std::move(motion)), options_(options) {
  const double usable_s = motion_->duration_s() - options_.sensor.geometry.sweep_s;
  scan_count_ = usable_s < 0.0 ? 0
                               : static_cast<std::uint64_t>(std::floor(
                                     usable_s * 1e6 / static_cast<double>(options_.sensor.period_us) + 1e-9)) +
                                     1;
  last_truth_ = motion_->at(0.0);
  if (options_.odometry) {
    CounterRandom random(options_.seed, kOdometryScaleStream, 0);
    distance_factor_ += options_.odometry->distance_scale * random.gaussian();
    turn_factor_ += options_.odometry->turn_scale * random.gaussian();
  }
}

Pose2 Simulator::truth(std::int64_t stamp_us) const {
  return motion_->at(1e-6 * static_cast<double>(stamp_us - options_.start_stamp_us));
}

std::optional<Scan> Simulator::next() {
  if (next_scan_ >= scan_count_) {
    return std::nullopt;
  }
  const SensorOptions& sensor = options_.sensor;
  const std::int64_t since_start_us = static_cast<std::int64_t>(next_scan_) * sensor.period_us;
  const double start_s = 1e-6 * static_cast<double>(since_start_us);

  Scan scan;
  scan.stamp_us = options_.start_stamp_us + since_start_us;
  scan.index = next_scan_;
  scan.geometry = sensor.geometry;
  scan.ranges_mm.resize(static_cast<std::size_t>(sensor.beams));
  const double beam_s = sensor.geometry.sweep_s / (sensor.beams - 1);
  if (options_.crowd) {
    constexpr double kMargin_m = 1.0;
    options_.crowd->near(start_s, motion_->at(start_s).translation(), sensor.geometry.range_max_m + kMargin_m, people_);
  }
  for (int i = 0; i < sensor.beams; ++i) {
    const Pose2 world_from_base = motion_->at(start_s + i * beam_s);
    Pose2 world_from_sensor = compose(world_from_base, sensor.geometry.base_from_sensor);
    world_from_sensor.yaw += sensor.geometry.first_angle_rad + i * sensor.geometry.angle_step_rad;
    scan.ranges_mm[static_cast<std::size_t>(i)] =
        measure(world_from_sensor, i * beam_s, scan.index, static_cast<std::uint64_t>(i));
  }
  if (options_.odometry) {
    advance_odometry(motion_->at(start_s), scan.index);
    scan.odometry = odometry_;
  }
  ++next_scan_;
  return scan;
}

// world_from_sensor.yaw is the beam's own direction.
std::uint16_t Simulator::measure(const Pose2& world_from_sensor, double since_scan_s, std::uint64_t scan,
                                 std::uint64_t beam) const {
  const SensorOptions& sensor = options_.sensor;
  const Eigen::Vector2d direction(std::cos(world_from_sensor.yaw), std::sin(world_from_sensor.yaw));
  CounterRandom at_surfaces(options_.seed, kSurfaceStream + scan, beam);
  const std::optional<Echo> hit = trace(*world_, people_, since_scan_s, world_from_sensor.translation(), direction,
                                        sensor.geometry.range_max_m, at_surfaces);
  if (!hit) {
    return kNoReturn_mm;
  }
  double range = hit->range_m + sensor.bias_m;
  if (sensor.noise) {
    constexpr double kGrazing = 0.1;  // cosine of the incidence, 6 deg between beam and wall
    CounterRandom random(options_.seed, kBeamStream + scan, beam);
    const double far_share = hit->range_m / 30.0;
    const double missing = sensor.missing_near + sensor.missing_far * far_share * far_share +
                           sensor.missing_grazing * std::max(0.0, 1.0 - hit->cos_incidence / kGrazing);
    if (random.uniform() < missing) {
      return kNoReturn_mm;
    }
    const double growth = std::clamp((hit->range_m - 10.0) / 20.0, 0.0, 1.0);
    range += (sensor.sigma_near_m + growth * (sensor.sigma_far_m - sensor.sigma_near_m)) * random.gaussian();
  }
  // Values up to kErrorCode_mm are no ranges.
  const double range_mm = std::round(1000.0 * range);
  const bool valid = range_mm > kErrorCode_mm && range <= sensor.geometry.range_max_m && range_mm <= 65535.0;
  return valid ? static_cast<std::uint16_t>(range_mm) : kNoReturn_mm;
}

void Simulator::advance_odometry(const Pose2& world_from_base, std::uint64_t scan) {
  const OdometryOptions& noise = *options_.odometry;
  Twist2 moved = log_pose(between(last_truth_, world_from_base), 1.0);
  CounterRandom random(options_.seed, kOdometryStream, scan);
  const double distance = std::abs(moved.vx);
  const double turned = std::abs(moved.wz);
  moved.vx = moved.vx * distance_factor_ + noise.distance_noise * std::sqrt(distance) * random.gaussian();
  moved.vy = 0.0;  // wheels do not feel sideways motion
  moved.wz = moved.wz * turn_factor_ + noise.turn_noise_rad * std::sqrt(turned) * random.gaussian() +
             noise.drift_rad * std::sqrt(distance) * random.gaussian();
  odometry_ = compose(odometry_, exp_twist(moved, 1.0));
  odometry_.yaw = wrap_angle(odometry_.yaw);
  last_truth_ = world_from_base;
}

}  // namespace submapd::tools
