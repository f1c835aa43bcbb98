#include "slam/landmark/landmark_candidates.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "slam/base/small_matrix.hpp"
#include "slam/grid/surface_map.hpp"

namespace submapd {
namespace {

constexpr double kAroundSpot_m = 0.75;  // surface that says where the spot is
constexpr double kSameSpot_m = 0.15;    // a's and b's surface, before refinement
constexpr double kSuppression_m = 0.5;
constexpr double kMinCosine = 0.8;  // 37 deg
constexpr double kAssociation_m = 0.20;
constexpr double kPriorSigma_m = 0.05;  // of the shift
constexpr double kMaxShift_m = 0.10;
constexpr double kAlongSigma_m = 0.5;  // of a spot along a bare wall: the wall says nothing
constexpr double kFloorSigma_m = 0.003;
constexpr double kPointSigma2_m2 = 0.03 * 0.03;  // of a mean that is no line
constexpr int kIterations = 4;
constexpr std::size_t kMinPairs = 3;
constexpr double kMinKnownShare = 0.3;  // of the cells around: beyond a wall nothing is known, nor need it be

// Enough hits and key-frames; sparse scans give few, so the demand falls until it leaves enough spots.
struct Demand {
  std::uint16_t hits;
  std::uint16_t keyframes;
};
constexpr Demand kDemands[] = {{5, 3}, {2, 2}, {1, 1}};
constexpr std::size_t kEnoughSpots = 40;

// Information of the line (or point) pair in the shift of the spot.
Eigen::Matrix2d pair_information(const Eigen::Vector2d& normal, bool line, double variance_m2) {
  return line ? Eigen::Matrix2d(normal * normal.transpose() / variance_m2)
              : Eigen::Matrix2d(Eigen::Matrix2d::Identity() / (variance_m2 + kPointSigma2_m2));
}

// Inflated covariance of a spot whose surroundings gave `information`: short across a wall, long along it.
Eigen::Matrix2d spot_covariance(const Eigen::Matrix2d& information, double inflation) {
  const double noise = kNormalNoiseShare * information.trace();
  const PrincipalAxes<2> principal = principal_axes(Eigen::Matrix2d(information / inflation));
  Eigen::Vector2d variance;
  for (int k = 0; k < 2; ++k) {
    const double value = std::max(0.0, principal.values[k] - noise / inflation);
    variance[k] = 1.0 / (value + 1.0 / (kAlongSigma_m * kAlongSigma_m)) + kFloorSigma_m * kFloorSigma_m;
  }
  return principal.axes * variance.asDiagonal() * principal.axes.transpose();
}

// Wants free space in front, where a scanner looked from, and not the ragged rim of what is known.
bool well_surrounded(const CellPlane& plane, const Eigen::Vector2d& place) {
  const Eigen::Vector2i cell = plane.cell_at(place);
  int known = 0;
  int free = 0;
  for (int y = -2; y <= 2; ++y) {
    for (int x = -2; x <= 2; ++x) {
      const CellKind kind = plane.kind(cell.x() + x, cell.y() + y);
      known += kind != CellKind::kUnknown ? 1 : 0;
      free += kind == CellKind::kFree || kind == CellKind::kDoubtful ? 1 : 0;
    }
  }
  return known >= kMinKnownShare * 25 && free > 0;
}

std::vector<std::int32_t> spots_meeting(const Demand& demand, const FinishedSubmap& a, const CellPlane& plane_a,
                                        const SurfaceIndex& surface_a, const SurfaceIndex& surface_b,
                                        const Pose2& b_from_a) {
  const Eigen::Matrix2d turn = rotation(b_from_a.yaw);
  std::vector<std::int32_t> spots;
  const auto& elements = surface_a.elements();
  for (std::size_t i = 0; i < elements.size(); ++i) {
    const SurfacePoint& point = a.surface[elements[i].source];
    if (point.hits < demand.hits || point.keyframes < demand.keyframes) {
      continue;
    }
    const Eigen::Vector2d in_b = turn * elements[i].mean + b_from_a.translation();
    if (surface_b.closest(in_b, turn * elements[i].normal, kSameSpot_m, kMinCosine) != SurfaceIndex::kNone &&
        well_surrounded(plane_a, elements[i].mean)) {
      spots.push_back(static_cast<std::int32_t>(i));
    }
  }
  return spots;
}

LandmarkCandidate describe(const Eigen::Vector2d& place, const SurfaceIndex& surface, double inflation) {
  std::vector<std::int32_t> around;
  surface.within(place, kAroundSpot_m, around);
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  for (const std::int32_t i : around) {
    const SurfaceElement& element = surface.elements()[static_cast<std::size_t>(i)];
    information += pair_information(element.normal, element.line_like(), element.variance_m2);
  }
  return {place, spot_covariance(information, inflation)};
}

}  // namespace

std::vector<LandmarkCandidate> find_candidates(const FinishedSubmap& a, const CellPlane& plane_a,
                                               const SurfaceIndex& surface_a, const SurfaceIndex& surface_b,
                                               const Pose2& a_from_b, const LandmarkOptions& options) {
  std::vector<std::int32_t> spots;
  for (const Demand& demand : kDemands) {
    spots = spots_meeting(demand, a, plane_a, surface_a, surface_b, inverse(a_from_b));
    if (spots.size() >= kEnoughSpots) {
      break;
    }
  }
  const auto& elements = surface_a.elements();
  const auto seen = [&](std::int32_t spot) -> const SurfacePoint& {
    return a.surface[elements[static_cast<std::size_t>(spot)].source];
  };
  std::stable_sort(spots.begin(), spots.end(), [&](std::int32_t l, std::int32_t r) {
    return seen(l).keyframes != seen(r).keyframes ? seen(l).keyframes > seen(r).keyframes : seen(l).hits > seen(r).hits;
  });
  std::vector<LandmarkCandidate> kept;
  for (const std::int32_t spot : spots) {
    const Eigen::Vector2d& place = elements[static_cast<std::size_t>(spot)].mean;
    const bool apart = std::all_of(kept.begin(), kept.end(), [&](const LandmarkCandidate& other) {
      return (other.place - place).squaredNorm() >= kSuppression_m * kSuppression_m;
    });
    if (apart) {
      kept.push_back(describe(place, surface_a, options.information_inflation));
    }
  }
  return kept;
}

std::optional<LandmarkPlace> refine_place(const LandmarkCandidate& candidate, const SurfaceIndex& surface_a,
                                          const SurfaceIndex& surface_b, const Pose2& a_from_b, double max_residual_m,
                                          const LandmarkOptions& options) {
  const Pose2 b_from_a = inverse(a_from_b);
  const Eigen::Matrix2d turn = rotation(b_from_a.yaw);
  std::vector<std::int32_t> around;
  surface_a.within(candidate.place, kAroundSpot_m, around);

  Eigen::Vector2d shift = Eigen::Vector2d::Zero();
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  double square_sum = 0.0;
  std::size_t pairs = 0;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    information.setZero();
    Eigen::Vector2d gradient = Eigen::Vector2d::Zero();
    square_sum = 0.0;
    pairs = 0;
    for (const std::int32_t i : around) {
      const SurfaceElement& element = surface_a.elements()[static_cast<std::size_t>(i)];
      const Eigen::Vector2d place = turn * element.mean + b_from_a.translation() + shift;
      const Eigen::Vector2d normal = turn * element.normal;
      const std::int32_t found = surface_b.closest(place, normal, kAssociation_m, kMinCosine);
      if (found == SurfaceIndex::kNone) {
        continue;
      }
      const SurfaceElement& mate = surface_b.elements()[static_cast<std::size_t>(found)];
      const bool line = mate.line_like() || element.line_like();
      const Eigen::Vector2d across = mate.line_like() ? mate.normal : normal;
      const Eigen::Vector2d offset = place - mate.mean;
      const Eigen::Matrix2d W = pair_information(across, line, element.variance_m2 + mate.variance_m2);
      information += W;
      gradient += W * offset;
      square_sum += line ? std::pow(across.dot(offset), 2) : offset.squaredNorm();
      ++pairs;
    }
    if (pairs < kMinPairs || 2 * pairs < around.size()) {
      return std::nullopt;
    }
    const Eigen::Matrix2d prior = Eigen::Matrix2d::Identity() / (kPriorSigma_m * kPriorSigma_m);
    shift -= solve_definite(Eigen::Matrix2d(information + prior), Eigen::Vector2d(gradient + prior * shift));
  }
  const double residual = std::sqrt(square_sum / static_cast<double>(pairs));
  if (shift.norm() > kMaxShift_m || residual > max_residual_m) {
    return std::nullopt;
  }
  return LandmarkPlace{transform(b_from_a, candidate.place) + shift,
                       spot_covariance(information, options.information_inflation)};
}

GreedyChoice::GreedyChoice(const std::vector<LandmarkCandidate>& candidates, double min_spacing_m)
    : candidates_(candidates), min_spacing_m_(min_spacing_m), open_(candidates.size(), true) {
  for (const LandmarkCandidate& candidate : candidates_) {
    middle_ += candidate.place / static_cast<double>(candidates_.size());
  }
  // What is known without landmarks, deliberately little: a metre and 20 deg.
  information_ = Eigen::Vector3d(1.0, 1.0, 8.0).asDiagonal();
}

// J^T Omega J of a relative pose error (t, yaw) about the middle, which moves the spot by [I | S q].
Eigen::Matrix3d GreedyChoice::information_of(std::size_t i) const {
  const Eigen::Vector2d q = candidates_[i].place - middle_;
  Eigen::Matrix<double, 2, 3> J;
  J << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
  return J.transpose() * candidates_[i].covariance.inverse() * J;
}

std::optional<std::size_t> GreedyChoice::next() {
  std::optional<std::size_t> best;
  double best_gain = 0.0;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    if (!open_[i]) {
      continue;
    }
    const double gain = (information_ + information_of(i)).determinant();
    if (!best || gain > best_gain) {
      best = i;
      best_gain = gain;
    }
  }
  if (best) {
    open_[*best] = false;
    last_ = *best;
  }
  return best;
}

void GreedyChoice::keep() {
  information_ += information_of(last_);
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    if ((candidates_[i].place - candidates_[last_].place).norm() < min_spacing_m_) {
      open_[i] = false;
    }
  }
}

}  // namespace submapd
