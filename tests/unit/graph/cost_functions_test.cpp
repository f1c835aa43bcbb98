#include "slam/graph/internal/cost_functions.hpp"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/manifold_test_utils.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd::graph {
namespace {

// The residuals once more, written for automatic differentiation: the oracle.
template <typename T>
T wrap(const T& angle) {
  using std::floor;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  return angle - kTurn * floor((angle + std::numbers::pi) / kTurn);
}

template <typename T>
Eigen::Matrix<T, 2, 1> seen_from(const T* pose, const T* point) {
  using std::cos;
  using std::sin;
  const T c = cos(pose[2]);
  const T s = sin(pose[2]);
  const T dx = point[0] - pose[0];
  const T dy = point[1] - pose[1];
  return {c * dx + s * dy, -s * dx + c * dy};
}

struct RelativePoseOracle {
  template <typename T>
  bool operator()(const T* i, const T* j, T* residual) const {
    const Eigen::Matrix<T, 2, 1> u = seen_from(i, j);
    const Eigen::Matrix<T, 3, 1> e(u(0) - z.x, u(1) - z.y, wrap<T>(j[2] - i[2] - z.yaw));
    Eigen::Map<Eigen::Matrix<T, 3, 1>>{residual} = white.cast<T>() * e;
    return true;
  }
  Pose2 z;
  Eigen::Matrix3d white;
};

struct LandmarkOracle {
  template <typename T>
  bool operator()(const T* i, const T* l, T* residual) const {
    const Eigen::Matrix<T, 2, 1> u = seen_from(i, l);
    Eigen::Map<Eigen::Matrix<T, 2, 1>>{residual} = white.cast<T>() * (u - z.cast<T>());
    return true;
  }
  Eigen::Vector2d z;
  Eigen::Matrix2d white;
};

struct CommonPlaceOracle {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residual) const {
    using std::cos;
    using std::sin;
    const std::array<T, 2> place{b[0] + cos(b[2]) * in_b.x() - sin(b[2]) * in_b.y(),
                                 b[1] + sin(b[2]) * in_b.x() + cos(b[2]) * in_b.y()};
    Eigen::Map<Eigen::Matrix<T, 2, 1>>{residual} = white.cast<T>() * (seen_from(a, place.data()) - in_a.cast<T>());
    return true;
  }
  Eigen::Vector2d in_a;
  Eigen::Vector2d in_b;
  Eigen::Matrix2d white;
};

// Residuals and both Jacobians of a cost function with blocks of 3 and N values.
template <int R, int N>
struct Evaluated {
  Eigen::Matrix<double, R, 1> residual;
  Eigen::Matrix<double, R, 3, Eigen::RowMajor> J_first;
  Eigen::Matrix<double, R, N, Eigen::RowMajor> J_second;

  Evaluated(const ceres::CostFunction& cost, const double* first, const double* second) {
    const std::array<const double*, 2> blocks{first, second};
    std::array<double*, 2> jacobians{J_first.data(), J_second.data()};
    EXPECT_TRUE(cost.Evaluate(blocks.data(), residual.data(), jacobians.data()));
  }
};

template <int R>
Eigen::Matrix<double, R, R> random_whitening(CounterRandom& random) {
  Eigen::Matrix<double, R, R> white = Eigen::Matrix<double, R, R>::Zero();
  for (int row = 0; row < R; ++row) {
    for (int column = 0; column <= row; ++column) white(row, column) = random.uniform(-30.0, 30.0);
  }
  return white;
}

Eigen::Vector3d random_pose(CounterRandom& random) {
  return {random.uniform(-50.0, 50.0), random.uniform(-50.0, 50.0), random.uniform(-12.0, 12.0)};
}

TEST(CostFunctions, RelativePoseAgreesWithAutomaticDerivatives) {
  CounterRandom random(7, 1, 0);
  for (int trial = 0; trial < 1000; ++trial) {
    const Pose2 z{random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0), random.uniform(-7.0, 7.0)};
    const Eigen::Matrix3d white = random_whitening<3>(random);
    const Eigen::Vector3d i = random_pose(random);
    const Eigen::Vector3d j = random_pose(random);
    const RelativePoseCost ours(z, white);
    const ceres::AutoDiffCostFunction<RelativePoseOracle, 3, 3, 3> oracle(new RelativePoseOracle{z, white});
    const Evaluated<3, 3> a(ours, i.data(), j.data());
    const Evaluated<3, 3> b(oracle, i.data(), j.data());
    ASSERT_LT((a.residual - b.residual).norm(), 1e-9 * (1.0 + b.residual.norm()));
    ASSERT_LT((a.J_first - b.J_first).norm(), 1e-9 * (1.0 + b.J_first.norm()));
    ASSERT_LT((a.J_second - b.J_second).norm(), 1e-9 * (1.0 + b.J_second.norm()));
  }
}

TEST(CostFunctions, LandmarkAgreesWithAutomaticDerivatives) {
  CounterRandom random(7, 2, 0);
  for (int trial = 0; trial < 1000; ++trial) {
    const Eigen::Vector2d z(random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0));
    const Eigen::Matrix2d white = random_whitening<2>(random);
    const Eigen::Vector3d i = random_pose(random);
    const Eigen::Vector2d l(random.uniform(-50.0, 50.0), random.uniform(-50.0, 50.0));
    const LandmarkCost ours(z, white);
    const ceres::AutoDiffCostFunction<LandmarkOracle, 2, 3, 2> oracle(new LandmarkOracle{z, white});
    const Evaluated<2, 2> a(ours, i.data(), l.data());
    const Evaluated<2, 2> b(oracle, i.data(), l.data());
    ASSERT_LT((a.residual - b.residual).norm(), 1e-9 * (1.0 + b.residual.norm()));
    ASSERT_LT((a.J_first - b.J_first).norm(), 1e-9 * (1.0 + b.J_first.norm()));
    ASSERT_LT((a.J_second - b.J_second).norm(), 1e-9 * (1.0 + b.J_second.norm()));
  }
}

// The sum of the places' losses, and the normal equations with every place weighed by the slope of its loss.
TEST(CostFunctions, CommonPlacesAgreeWithAutomaticDerivativesOfEachByItself) {
  CounterRandom random(7, 4, 0);
  for (int trial = 0; trial < 1000; ++trial) {
    const SharedCauchyLoss loss(2.0);
    CommonPlacesCost ours(loss);
    const Eigen::Vector3d i = random_pose(random);
    const Eigen::Vector3d j = random_pose(random);
    Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> g = Eigen::Matrix<double, 6, 1>::Zero();
    double sum = 0.0;
    for (int place = 0; place <= trial % 7; ++place) {
      const Eigen::Vector2d in_b(random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0));
      const std::array<double, 2> in_map{j(0) + std::cos(j(2)) * in_b.x() - std::sin(j(2)) * in_b.y(),
                                         j(1) + std::sin(j(2)) * in_b.x() + std::cos(j(2)) * in_b.y()};
      const Eigen::Vector2d off(random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2));
      const Eigen::Vector2d in_a = seen_from(i.data(), in_map.data()) + off;
      const Eigen::Matrix2d white = random_whitening<2>(random);
      ours.add(in_a, in_b, white);
      const ceres::AutoDiffCostFunction<CommonPlaceOracle, 2, 3, 3> oracle(new CommonPlaceOracle{in_a, in_b, white});
      const Evaluated<2, 3> one(oracle, i.data(), j.data());
      Eigen::Matrix<double, 2, 6> J;
      J << one.J_first, one.J_second;
      const double weight = loss.slope(one.residual.squaredNorm());
      H += weight * J.transpose() * J;
      g += weight * J.transpose() * one.residual;
      sum += loss.value(one.residual.squaredNorm());
    }
    const Evaluated<4, 3> a(ours, i.data(), j.data());
    Eigen::Matrix<double, 4, 6> J;
    J << a.J_first, a.J_second;
    ASSERT_NEAR(a.residual.squaredNorm(), sum, 1e-9 * sum);
    ASSERT_LT((J.transpose() * J - H).norm(), 1e-9 * H.norm());
    ASSERT_LT((J.transpose() * a.residual - g).norm(), 1e-9 * g.norm());
  }
}

// Two sides of equal covariance share an error: its squares, each whitened by its own side, are (1 + t)^2 s / 2 and
// (1 - t)^2 s / 2. The loss is the least over t.
TEST(SharedCauchyLoss, IsTheLeastThatTwoLossesComeTo) {
  constexpr double kScale = 1.7;
  const SharedCauchyLoss shared(kScale);
  const ceres::CauchyLoss cauchy(kScale);
  const auto both = [&](double s, double t) {
    std::array<double, 3> one{};
    std::array<double, 3> other{};
    cauchy.Evaluate(0.5 * s * (1.0 + t) * (1.0 + t), one.data());
    cauchy.Evaluate(0.5 * s * (1.0 - t) * (1.0 - t), other.data());
    return one[0] + other[0];
  };
  for (double s = 1e-3; s < 1e4; s *= 1.13) {
    double least = std::numeric_limits<double>::infinity();
    for (double t = 0.0; t <= 1.0; t += 1e-3) least = std::min(least, both(s, t));
    ASSERT_NEAR(shared.value(s), least, 1e-4 * least) << s;
    ASSERT_NEAR(shared.value(s), both(s, shared.lean(s)), 1e-9 * least) << s;
    const double rise = shared.value(s * (1.0 + 1e-6)) - shared.value(s);
    ASSERT_NEAR(rise / (1e-6 * s), shared.slope(s), 1e-4 * shared.slope(s)) << s;
  }
}

TEST(CostFunctions, HeadingResidualTakesTheShortWayAcrossPi) {
  const RelativePoseCost cost({0.0, 0.0, 0.0}, Eigen::Matrix3d::Identity());
  const std::array<double, 3> i{0.0, 0.0, std::numbers::pi - 0.01};
  for (const double turns : {-2.0, -1.0, 0.0, 1.0, 3.0}) {
    const std::array<double, 3> j{0.0, 0.0, -std::numbers::pi + 0.01 + turns * 2.0 * std::numbers::pi};
    const std::array<const double*, 2> blocks{i.data(), j.data()};
    std::array<double, 3> residual{};
    ASSERT_TRUE(cost.Evaluate(blocks.data(), residual.data(), nullptr));
    EXPECT_NEAR(residual[2], 0.02, 1e-12) << turns;
  }
}

TEST(PoseManifold, HoldsTheInvariantsOfAManifold) {
  using ceres::Vector;
  using namespace ceres;  // NOLINT: the matchers of the macro
  const PoseManifold manifold;
  CounterRandom random(7, 3, 0);
  for (int trial = 0; trial < 1000; ++trial) {
    Vector x = random_pose(random);
    // Within half a turn of x: beyond it the short way ends at the same heading, but another number.
    Vector delta(3);
    delta << random.uniform(-5.0, 5.0), random.uniform(-5.0, 5.0), random.uniform(-3.1, 3.1);
    Vector y = x;
    y[0] += random.uniform(-5.0, 5.0);
    y[2] += random.uniform(-3.1, 3.1);
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x, delta, y, 1e-9);
  }
}

TEST(PoseManifold, DifferenceTakesTheShortWayAcrossPi) {
  const PoseManifold manifold;
  const std::array<double, 3> x{0.0, 0.0, 3.1};
  const std::array<double, 3> y{0.0, 0.0, -3.1};
  std::array<double, 3> difference{};
  ASSERT_TRUE(manifold.Minus(y.data(), x.data(), difference.data()));
  EXPECT_NEAR(difference[2], 2.0 * std::numbers::pi - 6.2, 1e-12);
}

}  // namespace
}  // namespace submapd::graph
