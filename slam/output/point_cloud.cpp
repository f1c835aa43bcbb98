#include "slam/output/point_cloud.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/base/byte_io.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kLongestGap_us = 500'000;
constexpr std::size_t kPiece_bytes = 64U << 10;
constexpr std::size_t kPoint_bytes = 3 * sizeof(float) + sizeof(double);

std::string header_of(const CloudSize& size) {
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment submapd; map frame, m; time in s since 1970\n"
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty double time\n{}end_header\n",
      size.points, size.intensities ? "property ushort intensity\n" : "");
}

struct CloudPoint {
  Eigen::Vector3d map = Eigen::Vector3d::Zero();
  std::int64_t stamp_us = 0;
  std::uint16_t intensity = 0;
};

// Walks trajectory and scans in step, beam by beam.
class BeamWalk {
 public:
  using Take = std::function<Status(const CloudPoint&)>;

  // Without `placed` the points stay at the origin: who only counts need not wait for sines.
  BeamWalk(const ScannerMount& mount, CloudScans& scans, bool placed, Take take)
      : rotation_(mount.rotation()),
        translation_(mount.translation()),
        scans_(scans),
        placed_(placed),
        take_(std::move(take)) {}

  Status step_to(const SpooledPose& spooled, const Pose2& pose) {
    const bool broken = spooled.keyframe && !spooled.linked;
    const bool known = from_ && !broken && spooled.stamp_us - from_us_ <= kLongestGap_us;
    if (known) twist_ = log_pose(between(*from_, pose), 1.0);
    Status status = place_until(spooled.stamp_us, known);
    from_ = pose;
    from_us_ = spooled.stamp_us;
    return status;
  }
  [[nodiscard]] std::uint64_t scans() const { return used_; }
  [[nodiscard]] bool intensities() const { return intensities_; }

 private:
  // All beams measured before `until_us`.
  Status place_until(std::int64_t until_us, bool known) {
    while (more_) {
      if (!scan_ && !load()) return status_;
      if (!scan_) return {};
      const Scan& scan = scan_->scan;
      const double sweep_us = 1e6 * scan.geometry.sweep_s;
      const auto beams = scan.ranges_mm.size();
      for (; beam_ < beams; ++beam_) {
        const double since_us =
            beams > 1 ? sweep_us * static_cast<double>(beam_) / static_cast<double>(beams - 1) : 0.0;
        const double time_us = static_cast<double>(scan.stamp_us - from_us_) + since_us;
        if (time_us >= static_cast<double>(until_us - from_us_)) return {};
        if (!known || time_us < 0.0) continue;
        if (Status status = place(time_us / static_cast<double>(until_us - from_us_), since_us); !status.ok()) {
          return status;
        }
      }
      scan_.reset();
    }
    return {};
  }

  Status place(double share, double since_us) {
    const Scan& scan = scan_->scan;
    const std::uint16_t range_mm = scan.ranges_mm[beam_];
    const double range_m = 1e-3 * range_mm;
    if (range_mm == kNoReturn_mm || range_mm == kErrorCode_mm || range_m < scan.geometry.range_min_m ||
        range_m > scan.geometry.range_max_m) {
      return {};
    }
    CloudPoint point;
    point.stamp_us = scan.stamp_us + std::llround(since_us);
    if (placed_) {
      const Eigen::Vector3d in_base = range_m * rays_[beam_] + translation_;
      const Pose2 pose = compose(*from_, exp_twist(twist_, share));
      const Eigen::Vector2d flat = transform(pose, in_base.head<2>());
      point.map = {flat.x(), flat.y(), in_base.z()};
    }
    if (std::exchange(counted_, true) == false) ++used_;
    const bool has_intensity = beam_ < scan_->intensities.size();
    intensities_ = intensities_ || has_intensity;
    if (has_intensity) point.intensity = scan_->intensities[beam_];
    return take_(point);
  }

  bool load() {
    Expected<std::optional<CloudScan>> next = scans_.next();
    if (!next) {
      status_ = next.error();
      return false;
    }
    scan_ = std::move(*next);
    more_ = scan_.has_value();
    beam_ = 0;
    counted_ = false;
    if (more_) aim();
    return true;
  }

  // Where the beams point in base; all scans of a scanner are alike.
  void aim() {
    const Scan& scan = scan_->scan;
    if (rays_.size() == scan.ranges_mm.size() && scan.geometry == aimed_) return;
    aimed_ = scan.geometry;
    rays_.clear();
    for (std::size_t i = 0; i < scan.ranges_mm.size(); ++i) {
      const double angle = aimed_.first_angle_rad + static_cast<double>(i) * aimed_.angle_step_rad;
      rays_.push_back(rotation_ * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.0));
    }
  }

  const Eigen::Matrix3d rotation_;
  const Eigen::Vector3d translation_;
  CloudScans& scans_;
  const bool placed_;
  const Take take_;
  ScanGeometry aimed_;
  std::vector<Eigen::Vector3d> rays_;
  std::optional<CloudScan> scan_;
  std::size_t beam_ = 0;
  bool counted_ = false;
  bool more_ = true;
  std::optional<Pose2> from_;
  std::int64_t from_us_ = 0;
  Twist2 twist_;  // from there to the next pose, in unit time
  std::uint64_t used_ = 0;
  bool intensities_ = false;
  Status status_;
};

}  // namespace

Eigen::Matrix3d ScannerMount::rotation() const {
  return (Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) *
          Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

std::uint64_t CloudSize::bytes() const {
  return header_of(*this).size() + points * (kPoint_bytes + (intensities ? sizeof(std::uint16_t) : 0));
}

Expected<CloudSize> measure_cloud(const OptimizedTrajectory& trajectory, const ScannerMount& mount,
                                  const OpenCloudScans& open) {
  const Expected<std::unique_ptr<CloudScans>> scans = open();
  if (!scans) return failure(scans.error());
  CloudSize size;
  BeamWalk walk(mount, **scans, false, [&](const CloudPoint&) {
    ++size.points;
    return Status();
  });
  const Status status =
      trajectory.for_each([&](const SpooledPose& spooled, const Pose2& pose) { return walk.step_to(spooled, pose); });
  if (!status.ok()) return failure(status);
  size.scans = walk.scans();
  size.intensities = walk.intensities();
  return size;
}

Status write_cloud(const std::filesystem::path& path, const CloudSize& size, const OptimizedTrajectory& trajectory,
                   const ScannerMount& mount, const OpenCloudScans& open, const std::function<void(double)>& progress) {
  const Expected<std::unique_ptr<CloudScans>> scans = open();
  if (!scans) return scans.error();
  AtomicFile file(path);
  if (Status status = file.write(header_of(size)); !status.ok()) return status;
  std::uint64_t points = 0;
  ByteWriter piece;
  const auto flush = [&] {
    progress(static_cast<double>(points) / static_cast<double>(size.points));
    return file.write(piece.take());
  };
  BeamWalk walk(mount, **scans, true, [&](const CloudPoint& point) {
    if (points == size.points) return Status();
    ++points;
    for (int i = 0; i < 3; ++i) piece.put(static_cast<float>(point.map[i]));
    piece.put(1e-6 * static_cast<double>(point.stamp_us));
    if (size.intensities) piece.put(point.intensity);
    return piece.bytes().size() < kPiece_bytes ? Status() : flush();
  });
  Status status =
      trajectory.for_each([&](const SpooledPose& spooled, const Pose2& pose) { return walk.step_to(spooled, pose); });
  if (status.ok() && points != size.points) status = Status(StatusCode::kInternal, "the raw log has lost scans");
  if (status.ok()) status = flush();
  return status.ok() ? file.commit() : status;
}

}  // namespace submapd
