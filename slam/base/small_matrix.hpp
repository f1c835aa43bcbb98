// Decompositions of small symmetric matrices, compiled once: where they stand in a header or in many files, Eigen's
// templates for them are most of what the compiler does, and twice as much with sanitizers.
#pragma once

#include <Eigen/Core>

namespace submapd {

// x of A x = b by LDL^T; A symmetric and positive definite.
[[nodiscard]] Eigen::Vector2d solve_definite(const Eigen::Matrix2d& A, const Eigen::Vector2d& b);
[[nodiscard]] Eigen::Vector3d solve_definite(const Eigen::Matrix3d& A, const Eigen::Vector3d& b);

// Eigenvalues of a symmetric matrix, ascending, and their unit eigenvectors in the columns of `axes`.
template <int N>
struct PrincipalAxes {
  Eigen::Matrix<double, N, 1> values;
  Eigen::Matrix<double, N, N> axes;
};
[[nodiscard]] PrincipalAxes<2> principal_axes(const Eigen::Matrix2d& symmetric);
[[nodiscard]] PrincipalAxes<3> principal_axes(const Eigen::Matrix3d& symmetric);

// Of a pose (x, y, yaw), a covariance or an information, seen in axes turned by -yaw_rad: R A R^T.
[[nodiscard]] Eigen::Matrix3d turned(const Eigen::Matrix3d& A, double yaw_rad);

// L of L L^T = A; A symmetric and positive definite.
[[nodiscard]] Eigen::Matrix3d cholesky_root(const Eigen::Matrix3d& A);

}  // namespace submapd
