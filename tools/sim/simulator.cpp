#include "tools/sim/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

// Random streams of one seed; scans use theirs with the number of the beam.
constexpr std::uint64_t kBeamStream = 0x4245414D00000000;
constexpr std::uint64_t kSurfaceStream = 0x474C415300000000;
constexpr std::uint64_t kLossStream = 0x4C4F5353;
constexpr std::uint64_t kClockStream = 0x434C4F434B;
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
  CounterRandom of_device(options_.seed, kClockStream, 0);
  clock_rate_ = 1e-6 * options_.sensor.clock_ppm * of_device.uniform(-1.0, 1.0);
  bias_phase_rad_ = of_device.uniform(0.0, 2.0 * std::numbers::pi);
  if (options_.odometry) {
    CounterRandom random(options_.seed, kOdometryScaleStream, 0);
    distance_factor_ += options_.odometry->distance_scale * random.gaussian();
    turn_factor_ += options_.odometry->turn_scale * random.gaussian();
  }
}

double Simulator::start_s(std::uint64_t scan) const {
  return 1e-6 * static_cast<double>(static_cast<std::int64_t>(scan) * options_.sensor.period_us);
}

std::int64_t Simulator::stamp_us(std::uint64_t scan) const {
  const std::int64_t true_us = static_cast<std::int64_t>(scan) * options_.sensor.period_us;
  if (options_.sensor.clock_ppm == 0.0) {
    return options_.start_stamp_us + true_us;
  }
  const double told_ms = 1e-3 * static_cast<double>(true_us) * (1.0 + clock_rate_);
  return options_.start_stamp_us + 1000 * static_cast<std::int64_t>(std::floor(told_ms));
}

bool Simulator::lost(std::uint64_t scan) {
  CounterRandom random(options_.seed, kLossStream, scan);
  const double draw = random.uniform();
  if (draw < 0.1 * options_.sensor.lost_scans) {
    gap_end_ = std::max(gap_end_, scan + 1 + static_cast<std::uint64_t>(random.uniform(0.0, 20.0)));
  }
  return draw < options_.sensor.lost_scans || scan < gap_end_;
}

std::optional<Scan> Simulator::next() {
  while (next_scan_ < scan_count_ && lost(next_scan_)) {
    ++next_scan_;
  }
  if (next_scan_ >= scan_count_) {
    return std::nullopt;
  }
  Scan scan;
  scan.stamp_us = stamp_us(next_scan_);
  scan.index = next_scan_;
  scan.geometry = options_.sensor.geometry;
  look(scan.index);
  scan.ranges_mm.resize(echoes_.size());
  for (int i = 0; i < options_.sensor.beams; ++i) {
    scan.ranges_mm[static_cast<std::size_t>(i)] = measure(scan.index, i);
  }
  if (options_.odometry) {
    advance_odometry(truth(scan), scan.index);
    scan.odometry = odometry_;
  }
  ++next_scan_;
  return scan;
}

// Fills echoes_.
void Simulator::look(std::uint64_t scan) {
  const SensorOptions& sensor = options_.sensor;
  const double scan_s = start_s(scan);
  if (options_.crowd) {
    constexpr double kMargin_m = 1.0;
    options_.crowd->near(scan_s, motion_->at(scan_s).translation(), sensor.geometry.range_max_m + kMargin_m, people_);
  }
  const bool later = options_.later_world && scan_s >= 0.5 * motion_->duration_s();
  const World& world = later ? *options_.later_world : *world_;
  const double beam_s = sensor.geometry.sweep_s / (sensor.beams - 1);
  echoes_.resize(static_cast<std::size_t>(sensor.beams));
  for (int i = 0; i < sensor.beams; ++i) {
    echoes_[static_cast<std::size_t>(i)] = look_along(world, motion_->at(scan_s + i * beam_s), scan, i);
  }
}

std::optional<Echo> Simulator::look_along(const World& world, const Pose2& world_from_base, std::uint64_t scan,
                                          int beam) const {
  const ScanGeometry& geometry = options_.sensor.geometry;
  const double beam_s = beam * geometry.sweep_s / (options_.sensor.beams - 1);
  const double angle_rad = geometry.first_angle_rad + beam * geometry.angle_step_rad;
  CounterRandom random(options_.seed, kSurfaceStream + scan, static_cast<std::uint64_t>(beam));
  const Pose2 world_from_sensor = compose(world_from_base, geometry.base_from_sensor);
  const Eigen::Vector2d origin = world_from_sensor.translation();
  if (!options_.floor) {
    const double yaw = world_from_sensor.yaw + angle_rad;
    return trace(world, people_, beam_s, origin, {std::cos(yaw), std::sin(yaw)}, geometry.range_max_m, random);
  }
  // Ways in the plan become ranges along the tilted beam.
  const Eigen::Vector3d slanted = options_.floor->beam(world_from_base, geometry.base_from_sensor.yaw + angle_rad);
  const double plan = slanted.head<2>().norm();
  const Eigen::Vector2d direction = slanted.head<2>() / plan;
  std::optional<Echo> echo = trace(world, people_, beam_s, origin, direction, plan * geometry.range_max_m, random);
  const double limit_m = echo ? echo->range_m : plan * geometry.range_max_m;
  const double rise = slanted.z() / plan;
  if (const auto floor_m = options_.floor->meet(origin, direction, rise, limit_m)) {
    echo = Echo{*floor_m, std::min(1.0, std::abs(slanted.z()))};
  }
  if (echo) {
    echo->range_m /= plan;
  }
  return echo;
}

std::uint16_t Simulator::measure(std::uint64_t scan, int beam) const {
  const SensorOptions& sensor = options_.sensor;
  const std::optional<Echo>& echo = echoes_[static_cast<std::size_t>(beam)];
  if (!echo) {
    return kNoReturn_mm;
  }
  double range = echo->range_m + sensor.bias_m;
  if (sensor.noise) {
    constexpr double kGrazing = 0.1;  // cosine of the incidence, 6 deg between beam and wall
    CounterRandom random(options_.seed, kBeamStream + scan, static_cast<std::uint64_t>(beam));
    const double far_share = echo->range_m / 30.0;
    const double missing = sensor.missing_near + sensor.missing_far * far_share * far_share +
                           sensor.missing_grazing * std::max(0.0, 1.0 - echo->cos_incidence / kGrazing);
    if (random.uniform() < missing) {
      return kNoReturn_mm;
    }
    const double growth = std::clamp((echo->range_m - 10.0) / 20.0, 0.0, 1.0);
    range += (sensor.sigma_near_m + growth * (sensor.sigma_far_m - sensor.sigma_near_m)) * random.gaussian();
    range += systematic_m(*echo);
    if (sensor.mixed_pixels > 0.0 && random.uniform() < sensor.mixed_pixels) {
      range += random.uniform() * step_beside_m(beam);
    }
  }
  // Values up to kErrorCode_mm are no ranges.
  const double range_mm = std::round(1000.0 * range);
  const bool valid = range_mm > kErrorCode_mm && range <= sensor.geometry.range_max_m && range_mm <= 65535.0;
  return valid ? static_cast<std::uint16_t>(range_mm) : kNoReturn_mm;
}

double Simulator::systematic_m(const Echo& echo) const {
  constexpr double kWave_m = 6.0;
  const double wave = std::sin(2.0 * std::numbers::pi * echo.range_m / kWave_m + bias_phase_rad_);
  const double grazing = (1.0 - echo.cos_incidence) * (1.0 - echo.cos_incidence);
  return options_.sensor.range_bias_m * (0.4 * wave + 0.6 * grazing);
}

// How much farther a neighbouring beam reaches across an edge, 0 if there is none; a slanted wall is no edge.
double Simulator::step_beside_m(int beam) const {
  constexpr double kLeast_m = 0.05;
  constexpr double kMost_m = 1.5;  // pulses farther apart are told from each other
  const Echo& echo = *echoes_[static_cast<std::size_t>(beam)];
  const auto slant_m = [&](const Echo& e) {
    return e.range_m * options_.sensor.geometry.angle_step_rad *
           std::sqrt(std::max(0.0, 1.0 - e.cos_incidence * e.cos_incidence)) / std::max(e.cos_incidence, 1e-3);
  };
  for (const int other : {beam - 1, beam + 1}) {
    if (other < 0 || other >= options_.sensor.beams || !echoes_[static_cast<std::size_t>(other)]) {
      continue;
    }
    const Echo& beside = *echoes_[static_cast<std::size_t>(other)];
    const double step_m = beside.range_m - echo.range_m;
    if (std::abs(step_m) > kLeast_m + 2.0 * (slant_m(echo) + slant_m(beside)) && std::abs(step_m) < kMost_m) {
      return step_m;
    }
  }
  return 0.0;
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
