#include "slam/base/small_matrix.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "slam/base/pose2.hpp"

namespace submapd {
Eigen::Vector2d solve_definite(const Eigen::Matrix2d& A, const Eigen::Vector2d& b) {
  return A.ldlt().solve(b);
}

Eigen::Vector3d solve_definite(const Eigen::Matrix3d& A, const Eigen::Vector3d& b) {
  return A.ldlt().solve(b);
}

PrincipalAxes<2> principal_axes(const Eigen::Matrix2d& symmetric) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(symmetric);  // closed form: the iteration gains nothing at this size
  return {solver.eigenvalues(), solver.eigenvectors()};
}

PrincipalAxes<3> principal_axes(const Eigen::Matrix3d& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::Matrix3d turned(const Eigen::Matrix3d& A, double yaw_rad) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() = rotation(yaw_rad);
  return turn * A * turn.transpose();
}

Eigen::Matrix3d cholesky_root(const Eigen::Matrix3d& A) {
  return A.llt().matrixL();
}

}  // namespace submapd
