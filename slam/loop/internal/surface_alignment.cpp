#include "slam/loop/internal/surface_alignment.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "slam/base/small_matrix.hpp"

namespace submapd::internal {
namespace {

struct Stage {
  double radius_m;     // of association
  double cauchy_m;     // residual at which a pair weighs half
  int iterations;      // at most
  std::size_t stride;  // every so many elements
  double stop_m;       // a step below both of these ends the stage
  double stop_rad;
};
// The first two only lead into the last one's basin.
constexpr std::array<Stage, 3> kStages{
    {{0.40, 0.15, 6, 3, 1e-2, 1e-3}, {0.25, 0.06, 4, 2, 2e-3, 2e-4}, {0.15, 0.03, 6, 1, 5e-4, 5e-5}}};
constexpr double kMaxAcross_m = 0.10;            // residual of the last stage
constexpr double kMinCosine = 0.8;               // 37 deg
constexpr double kPointSigma2_m2 = 0.03 * 0.03;  // a mean that is no line says less about where the surface is
constexpr std::size_t kMinPairs = 20;
constexpr std::size_t kEnough = 700;      // elements of one sub-map; more tell nothing new: errors are of whole walls
constexpr double kComparisonSlack = 4.0;  // 2 mm, where alignments may differ by 3 cm

// Left multiplication by S = dR/dyaw R^T: turns a vector by 90 deg.
Eigen::Vector2d turned(const Eigen::Vector2d& v) {
  return {-v.y(), v.x()};
}

class NormalEquations {
 public:
  explicit NormalEquations(const Eigen::Vector2d& pivot) : pivot_(pivot) {}

  // b's surface at `moving` (a's frame) should lie at `fixed` along `normal`.
  void add_line(const Eigen::Vector2d& moving, const Eigen::Vector2d& fixed, const Eigen::Vector2d& normal,
                double variance_m2, double cauchy_m) {
    const double residual = normal.dot(moving - fixed);
    const Eigen::Vector3d J{normal.x(), normal.y(), normal.dot(turned(moving - pivot_))};
    const double ratio = residual / cauchy_m;
    const double weight = 1.0 / (variance_m2 * (1.0 + ratio * ratio));
    H_ += weight * J * J.transpose();
    g_ += weight * residual * J;
  }
  void add_pair(const Eigen::Vector2d& place) {
    ++pairs_;
    sum_ += place;
    sum_square_ += (place - pivot_).squaredNorm();
  }

  [[nodiscard]] std::size_t pairs() const { return pairs_; }
  [[nodiscard]] Eigen::Vector2d mean() const { return sum_ / static_cast<double>(pairs_); }
  [[nodiscard]] double rms_radius() const { return std::sqrt(sum_square_ / static_cast<double>(pairs_)); }
  [[nodiscard]] const Eigen::Matrix3d& information() const { return H_; }
  // Step about the pivot. A direction without information stays where the start has it.
  [[nodiscard]] Eigen::Vector3d step() const {
    const double radius2 = rms_radius() * rms_radius() + 1.0;
    const double hold = 1e-4 * (H_(0, 0) + H_(1, 1)) + 1.0;
    const Eigen::Vector3d damping(hold, hold, hold * radius2);
    return -solve_definite(H_ + Eigen::Matrix3d(damping.asDiagonal()), g_);
  }

 private:
  Eigen::Vector2d pivot_;
  Eigen::Matrix3d H_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g_ = Eigen::Vector3d::Zero();
  Eigen::Vector2d sum_ = Eigen::Vector2d::Zero();
  double sum_square_ = 0.0;
  std::size_t pairs_ = 0;
};

// Pairs every element of `points` with the closest of `target`, both given the pose of the points' frame in the
// target's. `to_a` takes a place of the target's frame to a's; points_move says whether the points are b's.
void add_direction(const SurfaceIndex& points, const SurfaceIndex& target, const Pose2& target_from_points,
                   const Pose2& a_from_target, bool points_move, const Stage& stage, NormalEquations& equations) {
  const Eigen::Matrix2d turn = rotation(target_from_points.yaw);
  const Eigen::Matrix2d to_a = rotation(a_from_target.yaw);
  const auto& elements = points.elements();
  const std::size_t stride = std::max(stage.stride, elements.size() / kEnough);
  const double stands_for = static_cast<double>(stride);
  for (std::size_t i = 0; i < elements.size(); i += stride) {
    const SurfaceElement& element = elements[i];
    const Eigen::Vector2d place = turn * element.mean + target_from_points.translation();
    const Eigen::Vector2d element_normal = turn * element.normal;
    const std::int32_t found = target.closest(place, element_normal, stage.radius_m, kMinCosine);
    if (found == SurfaceIndex::kNone) {
      continue;
    }
    const SurfaceElement& mate = target.elements()[static_cast<std::size_t>(found)];
    const double variance = (element.variance_m2 + mate.variance_m2) / stands_for;
    const Eigen::Vector2d place_a = to_a * place + a_from_target.translation();
    const Eigen::Vector2d mate_a = to_a * mate.mean + a_from_target.translation();
    const Eigen::Vector2d& moving = points_move ? place_a : mate_a;
    const Eigen::Vector2d& fixed = points_move ? mate_a : place_a;
    if (mate.line_like() || element.line_like()) {
      const Eigen::Vector2d normal = mate.line_like() ? mate.normal : element_normal;
      if (stage.radius_m < 0.2 && std::abs(normal.dot(place - mate.mean)) > kMaxAcross_m) {
        continue;
      }
      equations.add_line(moving, fixed, to_a * normal, variance, stage.cauchy_m);
    } else {
      equations.add_line(moving, fixed, Eigen::Vector2d::UnitX(), variance + kPointSigma2_m2 / stands_for,
                         stage.cauchy_m);
      equations.add_line(moving, fixed, Eigen::Vector2d::UnitY(), variance + kPointSigma2_m2 / stands_for,
                         stage.cauchy_m);
    }
    equations.add_pair(moving);
  }
}

NormalEquations linearise(const SurfaceIndex& a, const SurfaceIndex& b, const Pose2& a_from_b, AlignDirection direction,
                          const Stage& stage, const Eigen::Vector2d& pivot) {
  NormalEquations equations(pivot);
  if (direction != AlignDirection::kAOnB) {
    add_direction(b, a, a_from_b, Pose2{}, true, stage, equations);
  }
  if (direction != AlignDirection::kBOnA) {
    add_direction(a, b, inverse(a_from_b), a_from_b, false, stage, equations);
  }
  return equations;
}

// The pose after a motion (x, y, yaw) about the pivot.
Pose2 moved_about(const Pose2& pose, const Eigen::Vector2d& pivot, const Eigen::Vector3d& step) {
  const Eigen::Vector2d t = rotation(step.z()) * (pose.translation() - pivot) + pivot + step.head<2>();
  return {t.x(), t.y(), pose.yaw + step.z()};
}

}  // namespace

Alignment align_surfaces(const SurfaceIndex& a, const SurfaceIndex& b, const Pose2& start, AlignDirection direction,
                         AlignStages stages) {
  Alignment result;
  result.a_from_b = start;
  result.pivot = start.translation();
  // By itself the last stage serves to compare two alignments, not to tie by.
  const double slack = stages == AlignStages::kFineOnly ? kComparisonSlack : 1.0;
  std::optional<NormalEquations> equations;
  for (std::size_t s = stages == AlignStages::kCoarseToFine ? 0 : kStages.size() - 1; s < kStages.size(); ++s) {
    const Stage& stage = kStages[s];
    for (int i = 0; i < stage.iterations; ++i) {
      if (equations) result.pivot = equations->mean();
      equations = linearise(a, b, result.a_from_b, direction, stage, result.pivot);
      if (equations->pairs() < kMinPairs) {
        return result;
      }
      const Eigen::Vector3d step = equations->step();
      result.a_from_b = moved_about(result.a_from_b, result.pivot, step);
      if (step.head<2>().norm() < slack * stage.stop_m && std::abs(step.z()) < slack * stage.stop_rad) {
        break;
      }
    }
  }
  // Those before the last step, which was a small one.
  result.information = equations->information();
  result.rms_radius_m = equations->rms_radius();
  result.pairs = equations->pairs();
  result.a_from_b.yaw = wrap_angle(result.a_from_b.yaw);
  return result;
}

}  // namespace submapd::internal
