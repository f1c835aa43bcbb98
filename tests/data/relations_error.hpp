// Error of a trajectory against reference relations (Kuemmerle et al., "On measuring the accuracy of SLAM algorithms",
// Autonomous Robots 27(4), 2009): e = inverse(delta_ref) * delta_est for the motion between two stamps.
//
// A pose within 5 ms of a stamp is taken as it is; else poses at most 2 s apart are interpolated, position linearly and
// yaw the short way.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "slam/output/trajectory_file.hpp"

namespace submapd::test {

struct Relation {
  double from_s = 0.0;
  double to_s = 0.0;
  Pose2 delta;
};

// Lines "t1 t2 x y z roll pitch yaw"; stops at the first that is none, so check the number.
inline std::vector<Relation> read_relations(const std::filesystem::path& path) {
  std::vector<Relation> relations;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    std::istringstream row(line);
    Relation r;
    double unused = 0.0;
    if (!(row >> r.from_s >> r.to_s >> r.delta.x >> r.delta.y >> unused >> unused >> unused >> r.delta.yaw)) break;
    relations.push_back(r);
  }
  return relations;
}

struct RelationsError {
  std::size_t matched = 0;
  double mean_m = 0.0;
  double mean_rad = 0.0;
};

class TimedPoses {
 public:
  explicit TimedPoses(std::vector<StampedPose> poses) : poses_(std::move(poses)) {
    std::stable_sort(poses_.begin(), poses_.end(),
                     [](const StampedPose& a, const StampedPose& b) { return a.stamp_us < b.stamp_us; });
  }

  [[nodiscard]] std::optional<Pose2> at(double time_s) const {
    if (poses_.empty()) return std::nullopt;
    const auto after = std::lower_bound(poses_.begin(), poses_.end(), time_s,
                                        [](const StampedPose& p, double t) { return seconds(p) < t; });
    auto near = after == poses_.end() ? after - 1 : after;
    if (after != poses_.begin() && after != poses_.end() &&
        time_s - seconds(*(after - 1)) <= seconds(*after) - time_s) {
      near = after - 1;
    }
    if (std::abs(seconds(*near) - time_s) <= kTolerance_s) return near->pose;
    if (after == poses_.begin() || after == poses_.end()) return std::nullopt;
    const StampedPose& a = *(after - 1);
    const StampedPose& b = *after;
    const double gap_s = seconds(b) - seconds(a);
    if (gap_s > kMaxGap_s) return std::nullopt;
    const double u = (time_s - seconds(a)) / gap_s;
    return Pose2{a.pose.x + u * (b.pose.x - a.pose.x), a.pose.y + u * (b.pose.y - a.pose.y),
                 a.pose.yaw + u * wrap_angle(b.pose.yaw - a.pose.yaw)};
  }

 private:
  static constexpr double kTolerance_s = 0.005;
  static constexpr double kMaxGap_s = 2.0;
  static double seconds(const StampedPose& p) { return static_cast<double>(p.stamp_us) * 1e-6; }

  std::vector<StampedPose> poses_;
};

inline RelationsError relations_error(const TimedPoses& poses, const std::vector<Relation>& relations) {
  RelationsError error;
  for (const Relation& r : relations) {
    const std::optional<Pose2> from = poses.at(r.from_s);
    const std::optional<Pose2> to = poses.at(r.to_s);
    if (!from || !to) continue;
    const Pose2 off = between(r.delta, between(*from, *to));
    error.mean_m += std::hypot(off.x, off.y);
    error.mean_rad += std::abs(off.yaw);
    ++error.matched;
  }
  if (error.matched > 0) {
    error.mean_m /= static_cast<double>(error.matched);
    error.mean_rad /= static_cast<double>(error.matched);
  }
  return error;
}

}  // namespace submapd::test
