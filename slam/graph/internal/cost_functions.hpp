// The residuals of both graphs with analytic Jacobians, and the manifold their poses live on (design notes 11.1).
//
// A pose block is (x, y, yaw), a landmark block (x, y); metres and radians in the map frame. Stored yaw is never
// wrapped, residuals are. For Ceres only: included by least_squares.cpp and by tests.
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "slam/base/pose2.hpp"

namespace submapd::graph {

// e = W (R_iᵀ (t_j - t_i) - t_z, wrap(θ_j - θ_i - θ_z)); W whitens: WᵀW is the information of z.
class RelativePoseCost final : public ceres::SizedCostFunction<3, 3, 3> {
 public:
  RelativePoseCost(const Pose2& measurement, const Eigen::Matrix3d& whitening)
      : measurement_(measurement), whitening_(whitening) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* i = parameters[0];
    const double* j = parameters[1];
    const double c = std::cos(i[2]);
    const double s = std::sin(i[2]);
    const double dx = j[0] - i[0];
    const double dy = j[1] - i[1];
    const Eigen::Vector2d u(c * dx + s * dy, -s * dx + c * dy);
    const Eigen::Vector3d e(u.x() - measurement_.x, u.y() - measurement_.y, wrap_angle(j[2] - i[2] - measurement_.yaw));
    Eigen::Map<Eigen::Vector3d>{residuals} = whitening_ * e;
    if (jacobians == nullptr) return true;
    using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    if (jacobians[0] != nullptr) {
      Eigen::Matrix3d J;
      J << -c, -s, u.y(), s, -c, -u.x(), 0.0, 0.0, -1.0;
      Eigen::Map<RowMajor>{jacobians[0]} = whitening_ * J;
    }
    if (jacobians[1] != nullptr) {
      Eigen::Matrix3d J;
      J << c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0;
      Eigen::Map<RowMajor>{jacobians[1]} = whitening_ * J;
    }
    return true;
  }

 private:
  Pose2 measurement_;
  Eigen::Matrix3d whitening_;
};

// e = W (R_iᵀ (l - t_i) - z): landmark l seen at z from pose i.
class LandmarkCost final : public ceres::SizedCostFunction<2, 3, 2> {
 public:
  LandmarkCost(const Eigen::Vector2d& measurement, const Eigen::Matrix2d& whitening)
      : measurement_(measurement), whitening_(whitening) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* i = parameters[0];
    const double* l = parameters[1];
    const double c = std::cos(i[2]);
    const double s = std::sin(i[2]);
    const double dx = l[0] - i[0];
    const double dy = l[1] - i[1];
    const Eigen::Vector2d u(c * dx + s * dy, -s * dx + c * dy);
    Eigen::Map<Eigen::Vector2d>{residuals} = whitening_ * (u - measurement_);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      Eigen::Matrix<double, 2, 3> J;
      J << -c, -s, u.y(), s, -c, -u.x();
      Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>{jacobians[0]} = whitening_ * J;
    }
    if (jacobians[1] != nullptr) {
      Eigen::Matrix2d J;
      J << c, s, -s, c;
      Eigen::Map<Eigen::Matrix<double, 2, 2, Eigen::RowMajor>>{jacobians[1]} = whitening_ * J;
    }
    return true;
  }

 private:
  Eigen::Vector2d measurement_;
  Eigen::Matrix2d whitening_;
};

// The least that two Cauchy losses come to where two rows of like covariance may share one error s (whitened with the
// sum of both covariances) as they like: their squares are (1 + t)^2 s/2 and (1 - t)^2 s/2. While s is small they halve
// it, t = 0; beyond twice the squared scale it is cheaper to believe one side more, t^2 = 1 - 2/x for x = s / scale^2.
class SharedCauchyLoss {
 public:
  explicit SharedCauchyLoss(double scale) : squared_(scale * scale) {}

  [[nodiscard]] double value(double s) const {
    const double x = s / squared_;
    return squared_ * (x <= 2.0 ? 2.0 * std::log(1.0 + 0.5 * x) : std::log(2.0 * x));
  }
  [[nodiscard]] double slope(double s) const {
    const double x = s / squared_;
    return x <= 2.0 ? 1.0 / (1.0 + 0.5 * x) : 1.0 / x;
  }
  // t: 0 where both sides are believed alike, towards 1 where one is not believed at all.
  [[nodiscard]] double lean(double s) const { return std::sqrt(std::max(0.0, 1.0 - 2.0 * squared_ / s)); }

 private:
  double squared_;
};

// All places that two poses have in common, each seen from both and itself eliminated: u = R_aᵀ (t_b + R_b p_b - t_a) -
// p_a under the shared loss. Ceres gets a square root of their weighted normal equations in the relative pose, three
// rows however many places there are, and a fourth without derivatives for the rest of the sum. A step of Gauss-Newton
// is the same, at a fraction of the work.
class CommonPlacesCost final : public ceres::SizedCostFunction<4, 3, 3> {
 public:
  explicit CommonPlacesCost(const SharedCauchyLoss& loss) : loss_(loss) {}

  void add(const Eigen::Vector2d& in_a, const Eigen::Vector2d& in_b, const Eigen::Matrix2d& whitening) {
    places_.push_back({in_a, in_b, whitening.transpose() * whitening});
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* a = parameters[0];
    const double* b = parameters[1];
    const double c = std::cos(a[2]);
    const double s = std::sin(a[2]);
    const Eigen::Vector2d shift(c * (b[0] - a[0]) + s * (b[1] - a[1]), -s * (b[0] - a[0]) + c * (b[1] - a[1]));
    const Eigen::Matrix2d turn = rotation(b[2] - a[2]);
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();  // over (shift, turn)
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    double sum = 0.0;
    for (const Place& place : places_) {
      const Eigen::Vector2d lever = turn * place.in_b;
      const Eigen::Vector2d u = shift + lever - place.in_a;
      const Eigen::Vector2d force = place.information * u;
      const double squared = u.dot(force);
      const double weight = loss_.slope(squared);
      const Eigen::Vector2d by_turn(-lever.y(), lever.x());
      const Eigen::Vector2d column = weight * (place.information * by_turn);
      H.topLeftCorner<2, 2>() += weight * place.information;
      H.bottomLeftCorner<1, 2>() += column.transpose();
      H(2, 2) += by_turn.dot(column);
      g.head<2>() += weight * force;
      g.z() += weight * by_turn.dot(force);
      sum += loss_.value(squared);
    }
    const Root root(H, g);
    Eigen::Map<Eigen::Vector4d>{residuals} << root.e, std::sqrt(std::max(0.0, sum - root.e.squaredNorm()));
    if (jacobians == nullptr) return true;
    using RowMajor = Eigen::Matrix<double, 4, 3, Eigen::RowMajor>;
    const auto set = [&](double* jacobian, const Eigen::Matrix3d& relative) {
      Eigen::Map<RowMajor> J{jacobian};
      J.topRows<3>() = root.L.transpose() * relative;
      J.row(3).setZero();
    };
    Eigen::Matrix3d relative;
    if (jacobians[0] != nullptr) {
      relative << -c, -s, shift.y(), s, -c, -shift.x(), 0.0, 0.0, -1.0;
      set(jacobians[0], relative);
    }
    if (jacobians[1] != nullptr) {
      relative << c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0;
      set(jacobians[1], relative);
    }
    return true;
  }

 private:
  struct Place {
    Eigen::Vector2d in_a;
    Eigen::Vector2d in_b;
    Eigen::Matrix2d information;
  };
  // L Lᵀ = H and L e = g. What places do not tell (one alone says nothing of the turn) has no row.
  struct Root {
    Root(const Eigen::Matrix3d& H, const Eigen::Vector3d& g) {
      constexpr double kNothing = 1e-13;
      for (int k = 0; k < 3; ++k) {
        const double pivot = H(k, k) - L.row(k).squaredNorm();
        if (pivot <= kNothing * H(k, k)) continue;
        const double root = std::sqrt(pivot);
        e(k) = (g(k) - L.row(k).dot(e)) / root;
        for (int i = k + 1; i < 3; ++i) L(i, k) = (H(i, k) - L.row(i).dot(L.row(k))) / root;
        L(k, k) = root;
      }
    }
    Eigen::Matrix3d L = Eigen::Matrix3d::Zero();
    Eigen::Vector3d e = Eigen::Vector3d::Zero();
  };

  SharedCauchyLoss loss_;
  std::vector<Place> places_;
};

// Plane times circle. Plus leaves yaw unwrapped, so that an iterate never jumps; Minus takes the short way round.
class PoseManifold final : public ceres::Manifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return 3; }
  [[nodiscard]] int TangentSize() const override { return 3; }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    for (int k = 0; k < 3; ++k) x_plus_delta[k] = x[k] + delta[k];
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix3d>{jacobian}.setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    y_minus_x[0] = y[0] - x[0];
    y_minus_x[1] = y[1] - x[1];
    y_minus_x[2] = wrap_angle(y[2] - x[2]);
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix3d>{jacobian}.setIdentity();
    return true;
  }
};

}  // namespace submapd::graph
