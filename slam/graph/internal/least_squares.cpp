#include "slam/graph/internal/least_squares.hpp"

#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <dlfcn.h>
#include <glog/logging.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <memory>

#include "slam/graph/internal/cost_functions.hpp"
#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd::graph {
namespace {

// Below these a dense factorisation is the quickest. Above, points need no elimination of their own: the fill-reducing
// ordering of the whole finds them, and Schur's bookkeeping costs more than it saves.
constexpr std::size_t kDensePoses = 8;
constexpr std::size_t kDensePoints = 24;
constexpr std::size_t kDirectRows = 10'000;  // of landmarks: more would make the factor the largest user of memory
constexpr int kConjugateGradientSteps = 100;
constexpr double kConjugateGradientAccuracy = 0.1;

template <typename Matrix>
std::optional<Matrix> whiten(const Matrix& covariance, double scale) {
  if (!covariance.allFinite()) return std::nullopt;
  const Eigen::LLT<Matrix> cholesky(covariance);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  const Matrix inverse = cholesky.matrixL().solve(Matrix::Identity());
  if (!inverse.allFinite()) return std::nullopt;
  return std::sqrt(scale) * inverse;
}

double robust_half_cost(double squared, double scale) {
  return 0.5 * scale * scale * std::log1p(squared / (scale * scale));
}

ceres::LinearSolverType linear_solver(const LeastSquaresGraph& graph, bool direct) {
  if (graph.poses.size() <= kDensePoses && graph.points.size() <= kDensePoints) return ceres::DENSE_NORMAL_CHOLESKY;
  return direct || graph.point_rows.size() <= kDirectRows ? ceres::SPARSE_NORMAL_CHOLESKY : ceres::ITERATIVE_SCHUR;
}

// Ceres reports every refused step through glog, which writes to stderr unless told not to; what matters is in the
// Summary.
void silence_glog() {
  FLAGS_minloglevel = google::GLOG_FATAL;
}

class Cancellation : public ceres::IterationCallback {
 public:
  explicit Cancellation(const std::atomic<bool>* flag) : flag_(flag) {}
  [[nodiscard]] bool cancelled() const { return flag_ != nullptr && flag_->load(); }
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& /*summary*/) override {
    return cancelled() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  }

 private:
  const std::atomic<bool>* const flag_;
};

// CHOLMOD would clear its arrays by an OpenMP team of four: threads nobody has counted, with the caller's priority. It
// asks for that number itself; only a depth of no parallel regions at all keeps the calling thread alone. The runtime
// comes along with CHOLMOD, whichever it is, so it is asked for by name.
void keep_to_this_thread() {
  using SetLevels = void (*)(int);
  static const auto kSetLevels = reinterpret_cast<SetLevels>(::dlsym(RTLD_DEFAULT, "omp_set_max_active_levels"));
  if (kSetLevels != nullptr) kSetLevels(0);
}

}  // namespace

std::optional<Eigen::Matrix3d> whitening(const Eigen::Matrix3d& covariance, double scale) {
  return whiten(covariance, scale);
}
std::optional<Eigen::Matrix2d> whitening(const Eigen::Matrix2d& covariance, double scale) {
  return whiten(covariance, scale);
}

Eigen::Matrix3d whitening_or_soft(const Eigen::Matrix3d& covariance, double scale) {
  const auto white = whitening(covariance, scale);
  return white ? *white : *whitening(pose_covariance(kBreakM, kBreakRad));
}

double cost(const LeastSquaresGraph& graph, double cauchy_scale) {
  double sum = 0.0;
  for (const PoseRow& row : graph.pose_rows) {
    const Pose2 seen = between(graph.poses[row.from], graph.poses[row.to]);
    const Eigen::Vector3d e(seen.x - row.measurement.x, seen.y - row.measurement.y,
                            wrap_angle(seen.yaw - row.measurement.yaw));
    sum += 0.5 * (row.whitening * e).squaredNorm();
  }
  for (const PointRow& row : graph.point_rows) {
    const Eigen::Vector2d seen = transform(inverse(graph.poses[row.pose]), graph.points[row.point]);
    sum += robust_half_cost((row.whitening * (seen - row.measurement)).squaredNorm(), cauchy_scale);
  }
  return sum;
}

Expected<SolveSummary> solve(LeastSquaresGraph& graph, const SolveOptions& options) {
  silence_glog();
  keep_to_this_thread();
  std::vector<std::array<double, 3>> poses(graph.poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) poses[k] = {graph.poses[k].x, graph.poses[k].y, graph.poses[k].yaw};
  std::vector<Eigen::Vector2d> points = graph.points;

  PoseManifold manifold;
  ceres::CauchyLoss cauchy(options.cauchy_scale);
  ceres::Problem::Options ownership;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  for (auto& pose : poses) problem.AddParameterBlock(pose.data(), 3, &manifold);
  for (auto& point : points) problem.AddParameterBlock(point.data(), 2);
  for (const PoseRow& row : graph.pose_rows) {
    problem.AddResidualBlock(new RelativePoseCost(row.measurement, row.whitening), nullptr, poses[row.from].data(),
                             poses[row.to].data());
  }
  for (const PointRow& row : graph.point_rows) {
    problem.AddResidualBlock(new LandmarkCost(row.measurement, row.whitening), &cauchy, poses[row.pose].data(),
                             points[row.point].data());
  }
  problem.SetParameterBlockConstant(poses[0].data());

  ceres::Solver::Options solver;
  solver.linear_solver_type = linear_solver(graph, options.direct);
  if (solver.linear_solver_type == ceres::ITERATIVE_SCHUR) {
    solver.preconditioner_type = ceres::SCHUR_JACOBI;
    solver.max_linear_solver_iterations = kConjugateGradientSteps;
    solver.eta = kConjugateGradientAccuracy;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (auto& point : points) ordering->AddElementToGroup(point.data(), 0);
    for (auto& pose : poses) ordering->AddElementToGroup(pose.data(), 1);
    solver.linear_solver_ordering = ordering;
  }
  solver.max_num_iterations = options.max_iterations;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  solver.minimizer_progress_to_stdout = false;
  // Tight, so that it is the iterations and not a lucky step that end a solve.
  solver.function_tolerance = 1e-7;
  solver.parameter_tolerance = 1e-12;
  solver.gradient_tolerance = 1e-12;
  Cancellation cancellation(options.cancelled);
  solver.callbacks.push_back(&cancellation);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (cancellation.cancelled()) return failure(StatusCode::kUnavailable, "graph solver: the program ends");
  if (!summary.IsSolutionUsable()) {
    return failure(StatusCode::kInternal, "graph solver: " + summary.message + "; the graph keeps its last values");
  }
  for (std::size_t k = 0; k < poses.size(); ++k) graph.poses[k] = {poses[k][0], poses[k][1], poses[k][2]};
  graph.points = std::move(points);
  return SolveSummary{summary.initial_cost, summary.final_cost,
                      summary.num_successful_steps + summary.num_unsuccessful_steps};
}

}  // namespace submapd::graph
