// Decides whether a log's odometry is worth using (replay --odometry auto).
#pragma once

#include <optional>

#include "slam/filter/motion_model.hpp"

namespace submapd {

class OdometryGate {
 public:
  explicit OdometryGate(const MotionModelOptions& options) : options_(options) {}

  // Motion since the last scan by odometry, if both scans have it and it was ever seen to change.
  [[nodiscard]] std::optional<Pose2> motion(const std::optional<Pose2>& now);
  // Compares the last motion with what matching found; too many contradictions reject the odometry for good.
  void judge(const Pose2& odometry_delta, const Pose2& matched_delta);
  [[nodiscard]] bool rejected() const { return rejected_; }

 private:
  MotionModelOptions options_;
  std::optional<Pose2> last_;
  bool moved_ = false;
  bool rejected_ = false;
  int judged_ = 0;
  int contradictions_ = 0;
};

}  // namespace submapd
