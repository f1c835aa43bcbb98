#include "tests/unit/loop/synthetic_submap.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <utility>

#include "slam/base/random.hpp"
#include "slam/base/small_matrix.hpp"

namespace submapd::testing {
namespace {

constexpr double kCell_m = 0.05;
constexpr double kSurfaceCell_m = 0.10;
constexpr double kLogOccupied = 0.845868;  // ln 2.33
constexpr double kLogFree = -0.400478;     // ln 0.67
constexpr double kPullBack_m = 0.075;      // 1.5 cells

double cast(const World& world, const Eigen::Vector2d& origin, double angle_rad) {
  const Eigen::Vector2d direction(std::cos(angle_rad), std::sin(angle_rad));
  double nearest = 1e9;
  for (const Wall& wall : world.walls) {
    const Eigen::Vector2d along = wall.to - wall.from;
    const Eigen::Vector2d offset = wall.from - origin;
    const double cross = direction.x() * along.y() - direction.y() * along.x();
    if (std::abs(cross) < 1e-12) {
      continue;
    }
    const double range = (offset.x() * along.y() - offset.y() * along.x()) / cross;
    const double share = (offset.x() * direction.y() - offset.y() * direction.x()) / cross;
    if (range > 0.0 && share >= 0.0 && share <= 1.0) {
      nearest = std::min(nearest, range);
    }
  }
  return nearest;
}

using Cell = std::pair<int, int>;  // (y, x), so that maps are sorted as blocks and surfaces are

Cell cell_of_point(const Eigen::Vector2d& point, double side_m) {
  return {static_cast<int>(std::floor(point.y() / side_m)), static_cast<int>(std::floor(point.x() / side_m))};
}

struct Counts {
  int occupied = 0;
  int free = 0;
  std::int64_t last_scan = -1;
  bool hit_in_last = false;
};

struct Statistics {
  int hits = 0;
  int keyframes = 0;
  std::int64_t last_scan = -1;
  std::uint8_t sectors = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  Eigen::Vector2d view = Eigen::Vector2d::Zero();  // towards the scanner
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
};

class Builder {
 public:
  void hit(const Eigen::Vector2d& point, const Eigen::Vector2d& scanner, std::int64_t scan) {
    Counts& counts = counts_at(point);
    if (counts.last_scan != scan || !counts.hit_in_last) {
      ++counts.occupied;
    }
    counts.last_scan = scan;
    counts.hit_in_last = true;
    Statistics& cell = surface_[cell_of_point(point, kSurfaceCell_m)];
    ++cell.hits;
    cell.keyframes += cell.last_scan != scan ? 1 : 0;
    cell.last_scan = scan;
    cell.sum += point;
    cell.square += point * point.transpose();
    const Eigen::Vector2d towards = (scanner - point).normalized();
    cell.view += towards;
    const double turn = std::atan2(towards.y(), towards.x()) / (2.0 * std::numbers::pi);
    cell.sectors = static_cast<std::uint8_t>(cell.sectors | 1U << (static_cast<unsigned>((turn + 1.0) * 8.0) % 8U));
  }

  // Free up to range_m, at most once a scan and not where the scan has hit.
  void clear(const Eigen::Vector2d& from, double angle_rad, double range_m, std::int64_t scan) {
    const Eigen::Vector2d direction(std::cos(angle_rad), std::sin(angle_rad));
    for (double range = 0.0; range < range_m; range += 0.8 * kCell_m) {
      Counts& counts = counts_at(from + range * direction);
      if (counts.last_scan != scan) {
        ++counts.free;
        counts.last_scan = scan;
        counts.hit_in_last = false;
      }
    }
  }

  [[nodiscard]] std::vector<OccupancyBlock> blocks() const {
    std::vector<OccupancyBlock> sorted;
    for (const auto& [place, counts] : cells_) {
      OccupancyBlock block;
      block.by = place.first;
      block.bx = place.second;
      for (std::size_t i = 0; i < counts->size(); ++i) {
        const Counts& cell = (*counts)[i];
        if (cell.last_scan >= 0) {
          const double odds = std::exp(cell.occupied * kLogOccupied + cell.free * kLogFree);
          block.cells[i] = cell_of(odds / (1.0 + odds));
        }
      }
      sorted.push_back(block);
    }
    return sorted;
  }

  [[nodiscard]] std::vector<SurfacePoint> surface() const {
    std::vector<SurfacePoint> points;
    for (const auto& [cell, own] : surface_) {
      Statistics pooled;
      for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
          const auto other = surface_.find({cell.first + y, cell.second + x});
          if (other != surface_.end()) {
            pooled.hits += other->second.hits;
            pooled.sum += other->second.sum;
            pooled.square += other->second.square;
          }
        }
      }
      points.push_back(point_of(own, pooled));
    }
    return points;
  }

 private:
  static SurfacePoint point_of(const Statistics& own, const Statistics& pooled) {
    const Eigen::Vector2d mean = own.sum / own.hits;
    const Eigen::Vector2d middle = pooled.sum / pooled.hits;
    const PrincipalAxes<2> principal =
        principal_axes(Eigen::Matrix2d(pooled.square / pooled.hits - middle * middle.transpose()));
    SurfacePoint point;
    point.x = static_cast<float>(mean.x());
    point.y = static_cast<float>(mean.y());
    point.hits = static_cast<std::uint16_t>(std::min(own.hits, 65535));
    point.keyframes = static_cast<std::uint16_t>(own.keyframes);
    point.view_sectors = own.sectors;
    const double across = std::max(0.0, principal.values[0]);
    const double along = std::max(0.0, principal.values[1]);
    point.sigma_m = static_cast<float>(std::sqrt(across));
    if (pooled.hits >= 4 && across < 0.1 * along) {
      Eigen::Vector2d normal = principal.axes.col(0);
      normal *= normal.dot(own.view) < 0.0 ? -1.0 : 1.0;
      point.normal_x = static_cast<float>(normal.x());
      point.normal_y = static_cast<float>(normal.y());
    } else {
      point.sigma_m = static_cast<float>(std::sqrt(across + along));
    }
    return point;
  }

  using BlockCounts = std::array<Counts, static_cast<std::size_t>(kBlockCells) * kBlockCells>;

  Counts& counts_at(const Eigen::Vector2d& point) {
    const Cell cell = cell_of_point(point, kCell_m);
    const Cell place{cell.first >> 6, cell.second >> 6};
    if (last_ == nullptr || place != last_place_) {
      std::unique_ptr<BlockCounts>& counts = cells_[place];
      if (!counts) {
        counts = std::make_unique<BlockCounts>();
      }
      last_ = counts.get();
      last_place_ = place;
    }
    return (*last_)[static_cast<std::size_t>(((cell.first & 63) << 6) | (cell.second & 63))];
  }

  std::map<Cell, std::unique_ptr<BlockCounts>> cells_;  // by block
  BlockCounts* last_ = nullptr;                         // where the last look-up ended: most stay in a block
  Cell last_place_;
  std::map<Cell, Statistics> surface_;
};

std::vector<std::uint16_t> measure(const World& world, const TruePose& pose, const SyntheticOptions& options) {
  const ScanGeometry& geometry = options.sensor.geometry;
  std::vector<std::uint16_t> ranges;
  for (int i = 0; i < options.sensor.beams; ++i) {
    const double tau = geometry.sweep_s * i / (options.sensor.beams - 1);
    const Pose2 sensor = compose(compose(pose.world_from_base, exp_twist(pose.twist, tau)), geometry.base_from_sensor);
    const double exact =
        cast(world, sensor.translation(), sensor.yaw + geometry.first_angle_rad + i * geometry.angle_step_rad);
    CounterRandom random(options.seed, pose.scan_index, static_cast<std::uint64_t>(i));
    const double noisy = exact + options.sensor.noise_m * random.gaussian();
    const double counted = std::round(noisy / options.sensor.quantum_m) * options.sensor.quantum_m;
    const bool seen = counted >= geometry.range_min_m && counted <= geometry.range_max_m;
    ranges.push_back(seen ? static_cast<std::uint16_t>(std::lround(1000.0 * counted)) : kNoReturn_mm);
  }
  return ranges;
}

void insert(const Keyframe& keyframe, const SyntheticOptions& options, std::int64_t scan, Builder& builder) {
  const ScanGeometry& geometry = keyframe.geometry;
  const auto beams = static_cast<int>(keyframe.ranges_mm.size());
  std::vector<Pose2> sensors;
  for (int i = 0; i < beams; ++i) {
    const Pose2 base = compose(keyframe.pose, exp_twist(keyframe.twist, geometry.sweep_s * i / (beams - 1)));
    sensors.push_back(compose(base, geometry.base_from_sensor));
    const double range = 1e-3 * keyframe.ranges_mm[static_cast<std::size_t>(i)];
    if (range > 0.0) {
      const double angle = geometry.first_angle_rad + i * geometry.angle_step_rad;
      builder.hit(transform(sensors.back(), range * Eigen::Vector2d(std::cos(angle), std::sin(angle))),
                  sensors.back().translation(), scan);
    }
  }
  // Free space as a polygon between neighbouring beams, the shorter range of the two.
  const int parts = std::max(1, static_cast<int>(std::lround(geometry.angle_step_rad / (std::numbers::pi / 720.0))));
  for (int i = 0; i + 1 < beams; ++i) {
    const double range = 1e-3 * std::min(keyframe.ranges_mm[static_cast<std::size_t>(i)],
                                         keyframe.ranges_mm[static_cast<std::size_t>(i) + 1]);
    for (int part = 0; part < parts; ++part) {
      const Pose2& sensor = sensors[static_cast<std::size_t>(i)];
      const double angle = geometry.first_angle_rad + (i + static_cast<double>(part) / parts) * geometry.angle_step_rad;
      builder.clear(sensor.translation(), sensor.yaw + angle, std::min(range, options.carve_limit_m) - kPullBack_m,
                    scan);
    }
  }
}

}  // namespace

World& World::wall(double x0, double y0, double x1, double y1) {
  walls.push_back({{x0, y0}, {x1, y1}});
  return *this;
}

World& World::box(double x0, double y0, double x1, double y1) {
  return wall(x0, y0, x1, y0).wall(x1, y0, x1, y1).wall(x1, y1, x0, y1).wall(x0, y1, x0, y0);
}

SyntheticSensor SyntheticSensor::dense() {
  SyntheticSensor sensor;
  sensor.geometry.sweep_s = 0.01875;
  return sensor;
}

SyntheticSensor SyntheticSensor::sparse() {
  SyntheticSensor sensor;
  sensor.beams = 180;
  sensor.geometry.first_angle_rad = -0.5 * std::numbers::pi;
  sensor.geometry.angle_step_rad = std::numbers::pi / 180.0;
  sensor.noise_m = 0.01;
  sensor.quantum_m = 0.01;
  return sensor;
}

std::vector<TruePose> walk(const std::vector<Eigen::Vector2d>& way, double step_m, std::uint64_t first_scan,
                           const Twist2& twist) {
  constexpr double kTurn_rad = std::numbers::pi / 9.0;
  std::vector<TruePose> path;
  const auto add = [&](const Eigen::Vector2d& place, double yaw) {
    path.push_back({first_scan + path.size(), {place.x(), place.y(), yaw}, twist});
  };
  for (std::size_t leg = 0; leg + 1 < way.size(); ++leg) {
    const Eigen::Vector2d ahead = way[leg + 1] - way[leg];
    const double yaw = std::atan2(ahead.y(), ahead.x());
    if (!path.empty()) {
      const double before = path.back().world_from_base.yaw;
      const double turn = wrap_angle(yaw - before);
      const int turns = static_cast<int>(std::abs(turn) / kTurn_rad);
      for (int i = 1; i <= turns; ++i) {
        add(way[leg], before + turn * i / (turns + 1));
      }
    }
    const int steps = std::max(1, static_cast<int>(ahead.norm() / step_m));
    for (int i = 0; i < steps; ++i) {
      add(way[leg] + ahead * i / steps, yaw);
    }
  }
  return path;
}

FinishedSubmap make_submap(const World& world, const std::vector<TruePose>& path, const SyntheticOptions& options) {
  FinishedSubmap submap;
  submap.id.index = options.index;
  submap.cell_m = kCell_m;
  submap.odom_from_submap = path.front().world_from_base;
  Builder builder;
  for (const TruePose& pose : path) {
    Keyframe keyframe;
    keyframe.scan_index = pose.scan_index;
    keyframe.stamp_us = static_cast<std::int64_t>(pose.scan_index) * 100'000;
    keyframe.pose = between(path.front().world_from_base, pose.world_from_base);
    keyframe.twist = pose.twist;
    keyframe.step_covariance = Eigen::Vector3d(1e-5, 1e-5, 1e-6).asDiagonal();
    keyframe.geometry = options.sensor.geometry;
    keyframe.ranges_mm = measure(world, pose, options);
    insert(keyframe, options, static_cast<std::int64_t>(pose.scan_index), builder);
    submap.keyframes.push_back(std::move(keyframe));
  }
  submap.blocks = builder.blocks();
  submap.surface = builder.surface();
  return submap;
}

World office() {
  World world;
  world.box(0.0, 0.0, 20.0, 15.0);
  // A corridor in the middle, rooms on both sides, doors of a metre.
  world.wall(0.0, 6.0, 3.0, 6.0).wall(4.0, 6.0, 9.0, 6.0).wall(10.0, 6.0, 16.0, 6.0).wall(17.0, 6.0, 20.0, 6.0);
  world.wall(0.0, 8.2, 5.0, 8.2).wall(6.0, 8.2, 13.0, 8.2).wall(14.0, 8.2, 20.0, 8.2);
  world.wall(6.5, 0.0, 6.5, 6.0).wall(13.0, 0.0, 13.0, 6.0).wall(10.0, 8.2, 10.0, 15.0);
  // Furniture.
  world.box(0.6, 0.5, 1.8, 1.3).box(4.5, 2.0, 5.6, 3.4).box(8.0, 1.0, 9.2, 1.8).box(11.5, 3.5, 12.4, 5.2);
  world.box(15.0, 2.2, 16.6, 3.0).box(18.6, 0.2, 19.7, 1.4).box(2.0, 11.0, 3.6, 12.2).box(7.3, 13.2, 8.9, 14.1);
  world.box(12.0, 12.5, 13.2, 13.3).box(16.5, 9.5, 17.1, 11.9).box(19.0, 13.0, 19.8, 14.8);
  return world;
}

std::vector<Eigen::Vector2d> office_tour() {
  return {{3.5, 3.5},  {3.5, 7.0},   {9.5, 7.0},   {9.5, 3.0},  {9.5, 7.0},
          {13.5, 7.2}, {13.5, 10.5}, {15.5, 12.5}, {13.5, 10.5}};
}

}  // namespace submapd::testing
