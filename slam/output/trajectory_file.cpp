#include "slam/output/trajectory_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <limits>

#include "slam/output/internal/text_parser.hpp"

namespace submapd {
namespace {

constexpr std::uint64_t kMicrosPerSecond = 1000000;

// Seconds to microseconds, exact for plain decimals of up to six places; more places and exponents (numpy writes them)
// are rounded.
bool parse_seconds(std::string_view text, std::int64_t& stamp_us) {
  const bool negative = text.starts_with('-');
  const std::string_view digits = text.substr(negative ? 1 : 0);
  const std::size_t point = digits.find('.');
  const std::string_view whole = digits.substr(0, point);
  std::string micros(point == std::string_view::npos ? std::string_view() : digits.substr(point + 1));
  if (digits.find_first_of("eE") == std::string_view::npos && micros.size() <= 6) {
    micros.resize(6, '0');
    std::uint64_t seconds = 0;
    std::uint64_t rest_us = 0;
    if (!internal::parse_number(whole, seconds) || !internal::parse_number(micros, rest_us)) return false;
    const std::uint64_t most_us = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max()) + negative;
    if (seconds > (most_us - rest_us) / kMicrosPerSecond) return false;
    const std::uint64_t magnitude_us = seconds * kMicrosPerSecond + rest_us;
    stamp_us = static_cast<std::int64_t>(negative ? 0 - magnitude_us : magnitude_us);
    return true;
  }
  double seconds = 0.0;
  if (!internal::parse_number(text, seconds) || std::abs(seconds) > 9e12) return false;
  stamp_us = std::llround(seconds * 1e6);
  return true;
}

}  // namespace

std::string seconds_text(std::int64_t stamp_us) {
  const bool negative = stamp_us < 0;
  const std::uint64_t bits = static_cast<std::uint64_t>(stamp_us);
  const std::uint64_t magnitude_us = negative ? 0 - bits : bits;
  return fmt::format("{}{}.{:06}", negative ? "-" : "", magnitude_us / kMicrosPerSecond,
                     magnitude_us % kMicrosPerSecond);
}

Status TrajectoryFile::add(std::int64_t stamp_us, const Pose2& pose) {
  if (!std::isfinite(pose.x) || !std::isfinite(pose.y) || !std::isfinite(pose.yaw)) {
    return Status(StatusCode::kInvalidArgument, fmt::format("the pose at {} s is ({}, {}, {}): not written",
                                                            seconds_text(stamp_us), pose.x, pose.y, pose.yaw));
  }
  const double half_rad = wrap_angle(pose.yaw) / 2.0;
  return file_.print("{} {:.6f} {:.6f} 0 0 0 {:.9f} {:.9f}\n", seconds_text(stamp_us), pose.x, pose.y,
                     std::sin(half_rad), std::cos(half_rad));
}

Expected<std::vector<StampedPose>> read_tum(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return failure(StatusCode::kNotFound, path.string() + ": cannot open the trajectory");
  return read_tum(in, path.string());
}

Expected<std::vector<StampedPose>> read_tum(std::istream& in, std::string_view name) {
  internal::TextParser parser(in, name);
  std::vector<StampedPose> poses;
  while (parser.next_line()) {
    StampedPose stamped;
    double z = 0.0;
    double qx = 0.0;
    double qy = 0.0;
    double qz = 0.0;
    double qw = 0.0;
    if (!parse_seconds(parser.next_field(), stamped.stamp_us)) {
      return failure(parser.error("the timestamp is no number of seconds"));
    }
    if (!parser.next(stamped.pose.x) || !parser.next(stamped.pose.y) || !parser.next(z) || !parser.next(qx) ||
        !parser.next(qy) || !parser.next(qz) || !parser.next(qw) || !parser.at_line_end()) {
      return failure(parser.error("expected eight numbers: timestamp x y z qx qy qz qw"));
    }
    if (std::abs(qz) + std::abs(qw) < 1e-6) return failure(parser.error("the quaternion is no rotation about z"));
    stamped.pose.yaw = wrap_angle(2.0 * std::atan2(qz, qw));
    poses.push_back(stamped);
  }
  if (!parser.status().ok()) return failure(parser.status());
  return poses;
}

}  // namespace submapd
