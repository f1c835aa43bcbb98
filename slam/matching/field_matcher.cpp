#include "slam/matching/field_matcher.hpp"

#include <cmath>

#include "slam/base/small_matrix.hpp"

namespace submapd {
namespace {

struct FieldSample {
  float distance;  // cells
  float du;        // derivative per cell
  float dv;
};

// Bilinear look-up at (u, v) in cells, u = x / cell + bias. REQUIRES: 1 <= u, v <= kMapCells - 2.
inline FieldSample sample(const DistanceView& field, float u, float v) {
  const float su = u - 0.5F;
  const float sv = v - 0.5F;
  const int ix = static_cast<int>(su);
  const int iy = static_cast<int>(sv);
  const float fx = su - static_cast<float>(ix);
  const float fy = sv - static_cast<float>(iy);
  float d00;
  float d10;
  float d01;
  float d11;
  if ((ix & 63) != 63 && (iy & 63) != 63) {
    const std::uint8_t* p = field.plane((iy >> 6) * kDirectoryBlocks + (ix >> 6)) + (((iy & 63) << 6) | (ix & 63));
    d00 = static_cast<float>(p[0]);
    d10 = static_cast<float>(p[1]);
    d01 = static_cast<float>(p[64]);
    d11 = static_cast<float>(p[65]);
  } else {  // the four cells lie in two or four blocks
    d00 = static_cast<float>(field.at({ix, iy}));
    d10 = static_cast<float>(field.at({ix + 1, iy}));
    d01 = static_cast<float>(field.at({ix, iy + 1}));
    d11 = static_cast<float>(field.at({ix + 1, iy + 1}));
  }
  constexpr float kScale = 1.0F / kDistanceUnitsPerCell;
  const float low = d00 + fx * (d10 - d00);
  const float high = d01 + fx * (d11 - d01);
  return {kScale * (low + fy * (high - low)), kScale * ((1.0F - fy) * (d10 - d00) + fy * (d11 - d01)),
          kScale * (high - low)};
}

}  // namespace

Eigen::Vector3d solve_step(const NormalEquations& equations, double kappa, const Pose2& pose,
                           const MotionPrior& prior) {
  const Eigen::Vector3d off(pose.x - prior.pose.x, pose.y - prior.pose.y, wrap_angle(pose.yaw - prior.pose.yaw));
  // The small diagonal keeps the system solvable when neither map nor prior says anything.
  Eigen::Matrix3d A = equations.H / kappa + prior.information;
  A.diagonal().array() += 1e-6;
  return solve_definite(A, -(equations.g / kappa + prior.information * off));
}

MatchResult match_field(std::span<const ScanPoint> points, const DistanceView& field, double cell_m, const Pose2& start,
                        const MotionPrior& prior, const FieldMatcherOptions& options) {
  MatchResult result;
  result.pose = start;
  if (points.empty()) return result;
  const auto cells_per_m = static_cast<float>(1.0 / cell_m);
  const auto cell = static_cast<float>(cell_m);
  const auto inverse_c2 = static_cast<float>(1.0 / (options.cauchy_m * options.cauchy_m));
  const double inverse_s2 = 1.0 / (options.sigma_m * options.sigma_m);
  constexpr auto kFarCells = static_cast<float>(kDistanceRadiusCells) - 0.01F;

  for (int pass = 0;; ++pass) {
    const auto c = static_cast<float>(std::cos(result.pose.yaw));
    const auto s = static_cast<float>(std::sin(result.pose.yaw));
    const auto tx = static_cast<float>(result.pose.x);
    const auto ty = static_cast<float>(result.pose.y);
    NormalEquations equations;
    int matched = 0;
    double distance_sum = 0.0;
    for (const ScanPoint& p : points) {
      const float rx = c * p.x - s * p.y;
      const float ry = s * p.x + c * p.y;
      const float u = (tx + rx) * cells_per_m + static_cast<float>(kMapBias);
      const float v = (ty + ry) * cells_per_m + static_cast<float>(kMapBias);
      if (!(u >= 1.0F && v >= 1.0F && u <= static_cast<float>(kMapCells - 2) &&
            v <= static_cast<float>(kMapCells - 2))) {
        continue;
      }
      const FieldSample f = sample(field, u, v);
      if (f.distance >= kFarCells) continue;
      const float d = f.distance * cell;
      ++matched;
      distance_sum += static_cast<double>(d);
      const float w = 1.0F / (1.0F + d * d * inverse_c2);
      // dD/dx is du cells per cell, i.e. metres per metre.
      equations.add(static_cast<double>(f.du), static_cast<double>(f.dv), static_cast<double>(-f.du * ry + f.dv * rx),
                    static_cast<double>(d), static_cast<double>(w) * inverse_s2);
    }
    equations.complete();
    result.information = equations.H;
    result.health.matched_ratio = static_cast<double>(matched) / static_cast<double>(points.size());
    result.health.mean_distance_m = matched > 0 ? distance_sum / matched : 0.0;
    result.health.iterations = pass;
    if (pass == options.max_iterations) break;
    const Eigen::Vector3d step = solve_step(equations, options.kappa, result.pose, prior);
    result.pose.x += step(0);
    result.pose.y += step(1);
    result.pose.yaw += step(2);
    if (step.head<2>().norm() < options.stop_m && std::abs(step(2)) < options.stop_rad) break;
  }
  return result;
}

LikelihoodTable::LikelihoodTable(const LikelihoodOptions& options, double cell_m) : kappa_(options.kappa) {
  const double floor = (1.0 - options.hit_share) * std::exp(-0.5 * 9.0);
  for (std::size_t i = 0; i < log_p_.size(); ++i) {
    // The far value stands for unknown and for deep free space alike: half the radius.
    const double units = i == kDistanceFar ? 0.5 * kDistanceFar : static_cast<double>(i);
    const double z = units / kDistanceUnitsPerCell * cell_m / options.sigma_m;
    log_p_[i] = static_cast<float>(std::log(options.hit_share * std::exp(-0.5 * z * z) + floor));
  }
}

double LikelihoodTable::log_likelihood(std::span<const ScanPoint> points, const DistanceView& field, double cell_m,
                                       const Pose2& pose) const {
  const auto c = static_cast<float>(std::cos(pose.yaw));
  const auto s = static_cast<float>(std::sin(pose.yaw));
  const auto tx = static_cast<float>(pose.x);
  const auto ty = static_cast<float>(pose.y);
  const double cells_per_m = 1.0 / cell_m;
  double sum = 0.0;
  for (const ScanPoint& p : points) {
    const CellIndex cell =
        cell_at(static_cast<double>(tx + c * p.x - s * p.y), static_cast<double>(ty + s * p.x + c * p.y), cells_per_m);
    sum += static_cast<double>(log_p_[field.at(cell)]);
  }
  return sum / kappa_;
}

}  // namespace submapd
