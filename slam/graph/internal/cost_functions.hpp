// The residuals of both graphs with analytic Jacobians, and the manifold their poses live on (design notes 11.1).
//
// A pose block is (x, y, yaw), a landmark block (x, y); metres and radians in the map frame. Stored yaw is never
// wrapped, residuals are. For Ceres only: included by least_squares.cpp and by tests.
#pragma once

#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

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

// e = W (R_aᵀ (t_b + R_b p_b - t_a) - p_a): one place seen from two poses, the place itself eliminated.
class CommonPlaceCost final : public ceres::SizedCostFunction<2, 3, 3> {
 public:
  CommonPlaceCost(const Eigen::Vector2d& in_a, const Eigen::Vector2d& in_b, const Eigen::Matrix2d& whitening)
      : in_a_(in_a), in_b_(in_b), whitening_(whitening) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* a = parameters[0];
    const double* b = parameters[1];
    const double ca = std::cos(a[2]);
    const double sa = std::sin(a[2]);
    const double cb = std::cos(b[2]);
    const double sb = std::sin(b[2]);
    const Eigen::Vector2d turned(cb * in_b_.x() - sb * in_b_.y(), sb * in_b_.x() + cb * in_b_.y());
    const double dx = b[0] + turned.x() - a[0];
    const double dy = b[1] + turned.y() - a[1];
    const Eigen::Vector2d u(ca * dx + sa * dy, -sa * dx + ca * dy);
    Eigen::Map<Eigen::Vector2d>{residuals} = whitening_ * (u - in_a_);
    if (jacobians == nullptr) return true;
    using RowMajor = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
    if (jacobians[0] != nullptr) {
      Eigen::Matrix<double, 2, 3> J;
      J << -ca, -sa, u.y(), sa, -ca, -u.x();
      Eigen::Map<RowMajor>{jacobians[0]} = whitening_ * J;
    }
    if (jacobians[1] != nullptr) {
      Eigen::Matrix<double, 2, 3> J;
      J << ca, sa, -ca * turned.y() + sa * turned.x(), -sa, ca, sa * turned.y() + ca * turned.x();
      Eigen::Map<RowMajor>{jacobians[1]} = whitening_ * J;
    }
    return true;
  }

 private:
  Eigen::Vector2d in_a_;
  Eigen::Vector2d in_b_;
  Eigen::Matrix2d whitening_;
};

// The least that two Cauchy losses come to where two rows of like covariance may share one error s (whitened with the
// sum of both covariances) as they like: their squares are (1 + t)^2 s/2 and (1 - t)^2 s/2. While s is small they halve
// it, t = 0; beyond twice the squared scale it is cheaper to believe one side more, t^2 = 1 - 2/x for x = s / scale^2.
class SharedCauchyLoss final : public ceres::LossFunction {
 public:
  explicit SharedCauchyLoss(double scale) : squared_(scale * scale) {}

  void Evaluate(double s, double out[3]) const override {
    const double x = s / squared_;
    if (x <= 2.0) {
      const double inside = 1.0 + 0.5 * x;
      out[0] = 2.0 * squared_ * std::log(inside);
      out[1] = 1.0 / inside;
      out[2] = -0.5 / (squared_ * inside * inside);
    } else {
      out[0] = squared_ * std::log(2.0 * x);
      out[1] = 1.0 / x;
      out[2] = -1.0 / (squared_ * x * x);
    }
  }
  // t: 0 where both sides are believed alike, towards 1 where one is not believed at all.
  [[nodiscard]] double lean(double s) const { return std::sqrt(std::max(0.0, 1.0 - 2.0 * squared_ / s)); }

 private:
  double squared_;
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
