// The residuals of both graphs with analytic Jacobians, and the manifold their poses live on (design notes 11.1).
//
// A pose block is (x, y, yaw), a landmark block (x, y); metres and radians in the map frame. Stored yaw is never
// wrapped, residuals are. For Ceres only: included by least_squares.cpp and by tests.
#pragma once

#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Core>
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
