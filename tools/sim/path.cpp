#include "tools/sim/path.hpp"

#include <algorithm>
#include <cmath>

namespace submapd::tools {
namespace {

constexpr double kSampleStep_m = 0.05;
constexpr double kKnotStep_m = 0.1;

// Moving average over 2 * half + 1 points; beyond an end the line goes on point-mirrored, so ends stay where they are.
std::vector<Eigen::Vector2d> box_filter(const std::vector<Eigen::Vector2d>& points, std::ptrdiff_t half) {
  const auto count = static_cast<std::ptrdiff_t>(points.size());
  half = std::min(half, count - 1);
  const auto at = [&](std::ptrdiff_t i) -> Eigen::Vector2d {
    if (i < 0) {
      return 2.0 * points.front() - points[static_cast<std::size_t>(-i)];
    }
    if (i >= count) {
      return 2.0 * points.back() - points[static_cast<std::size_t>(2 * (count - 1) - i)];
    }
    return points[static_cast<std::size_t>(i)];
  };
  std::vector<Eigen::Vector2d> smooth(points.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (std::ptrdiff_t k = -half; k <= half; ++k) {
      sum += at(i + k);
    }
    smooth[static_cast<std::size_t>(i)] = sum / static_cast<double>(2 * half + 1);
  }
  return smooth;
}

}  // namespace

double PathPoint::heading_rad() const { return std::atan2(first.y(), first.x()); }

double PathPoint::curvature() const {
  const double norm = first.norm();
  return (first.x() * second.y() - first.y() * second.x()) / (norm * norm * norm);
}

std::vector<Eigen::Vector2d> resample(const std::vector<Eigen::Vector2d>& polyline, double step_m) {
  std::vector<double> arc(polyline.size(), 0.0);
  for (std::size_t i = 1; i < polyline.size(); ++i) {
    arc[i] = arc[i - 1] + (polyline[i] - polyline[i - 1]).norm();
  }
  const auto pieces = static_cast<std::size_t>(std::max(2.0, std::round(arc.back() / step_m)));
  std::vector<Eigen::Vector2d> points;
  points.reserve(pieces + 1);
  std::size_t next = 1;
  for (std::size_t i = 0; i <= pieces; ++i) {
    const double s = arc.back() * static_cast<double>(i) / static_cast<double>(pieces);
    while (next + 1 < polyline.size() && arc[next] < s) {
      ++next;
    }
    const double piece = arc[next] - arc[next - 1];
    const double share = piece > 0.0 ? std::clamp((s - arc[next - 1]) / piece, 0.0, 1.0) : 1.0;
    points.push_back(polyline[next - 1] + share * (polyline[next] - polyline[next - 1]));
  }
  return points;
}

Path::Path(const std::vector<Eigen::Vector2d>& waypoints, double smoothing_m) {
  std::vector<Eigen::Vector2d> points = resample(waypoints, kSampleStep_m);
  const auto half = static_cast<std::ptrdiff_t>(std::lround(0.5 * smoothing_m / kSampleStep_m));
  for (int pass = 0; pass < 3; ++pass) {
    points = box_filter(points, half);
  }
  knots_ = resample(points, kKnotStep_m);
  length_m_ = 0.0;
  for (std::size_t i = 1; i < knots_.size(); ++i) {
    length_m_ += (knots_[i] - knots_[i - 1]).norm();
  }
  const std::size_t count = knots_.size();
  step_m_ = length_m_ / static_cast<double>(count - 1);

  // Natural cubic spline: m_{i-1} + 4 m_i + m_{i+1} = 6 (p_{i-1} - 2 p_i + p_{i+1}) / h^2, solved by elimination.
  second_.assign(count, Eigen::Vector2d::Zero());
  std::vector<double> factor(count, 0.0);
  for (std::size_t i = 1; i + 1 < count; ++i) {
    const Eigen::Vector2d right = 6.0 / (step_m_ * step_m_) * (knots_[i - 1] - 2.0 * knots_[i] + knots_[i + 1]);
    const double pivot = 4.0 - factor[i - 1];
    factor[i] = 1.0 / pivot;
    second_[i] = (right - second_[i - 1]) / pivot;
  }
  for (std::size_t i = count - 2; i > 0; --i) {
    second_[i] -= factor[i] * second_[i + 1];
  }
}

PathPoint Path::at(double s) const {
  const double position = std::clamp(s / step_m_, 0.0, static_cast<double>(knots_.size() - 1));
  const std::size_t i = std::min(static_cast<std::size_t>(position), knots_.size() - 2);
  const double b = position - static_cast<double>(i);
  const double a = 1.0 - b;
  const double h = step_m_;
  const Eigen::Vector2d& m0 = second_[i];
  const Eigen::Vector2d& m1 = second_[i + 1];
  PathPoint point;
  point.position =
      a * knots_[i] + b * knots_[i + 1] + h * h / 6.0 * ((a * a * a - a) * m0 + (b * b * b - b) * m1);
  point.first = (knots_[i + 1] - knots_[i]) / h + h / 6.0 * ((1.0 - 3.0 * a * a) * m0 + (3.0 * b * b - 1.0) * m1);
  point.second = a * m0 + b * m1;
  return point;
}

}  // namespace submapd::tools
