#include "slam/filter/internal/odometry_gate.hpp"

#include <cmath>

namespace submapd {
namespace {

constexpr double kCounted_m = 1e-4;
constexpr double kCounted_rad = 1e-4;
constexpr double kContradictionSigmas = 6.0;
constexpr int kWindow = 100;            // judged motions before counts are halved
constexpr int kMaxContradictions = 40;  // of the last ones

}  // namespace

std::optional<Pose2> OdometryGate::motion(const std::optional<Pose2>& now) {
  const std::optional<Pose2> before = last_;
  last_ = now;
  if (!before || !now) return std::nullopt;
  const Pose2 delta = between(*before, *now);
  if (std::hypot(delta.x, delta.y) > kCounted_m || std::abs(delta.yaw) > kCounted_rad) moved_ = true;
  if (!moved_ || rejected_) return std::nullopt;
  return delta;
}

void OdometryGate::judge(const Pose2& odometry_delta, const Pose2& matched_delta) {
  const PredictedMotion expected = predict_by_odometry(odometry_delta, options_);
  const Pose2 off = between(odometry_delta, matched_delta);
  const bool contradiction = std::hypot(off.x, off.y) > kContradictionSigmas * expected.sigma(0) ||
                             std::abs(off.yaw) > kContradictionSigmas * expected.sigma(2);
  ++judged_;
  contradictions_ += contradiction ? 1 : 0;
  if (contradictions_ >= kMaxContradictions) rejected_ = true;
  if (judged_ >= kWindow) {
    judged_ /= 2;
    contradictions_ /= 2;
  }
}

}  // namespace submapd
