#include "slam/graph/internal/least_squares.hpp"

#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <dlfcn.h>
#include <glog/logging.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "slam/graph/internal/cost_functions.hpp"
#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd::graph {
namespace {

// Below these a dense factorisation is the quickest. Above, points need no elimination of their own: the fill-reducing
// ordering of the whole finds them, and Schur's bookkeeping costs more than it saves.
constexpr std::size_t kDensePoses = 8;
constexpr std::size_t kDensePoints = 24;

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

ceres::LinearSolverType linear_solver(std::size_t poses, std::size_t points) {
  return poses <= kDensePoses && points <= kDensePoints ? ceres::DENSE_NORMAL_CHOLESKY : ceres::SPARSE_NORMAL_CHOLESKY;
}

// A point that is seen just twice, from different poses. What it says is how these two lie to each other: it is
// eliminated by hand, which leaves the solver the poses alone, and placed when they are known.
struct CommonPlace {
  const PointRow* first = nullptr;
  const PointRow* second = nullptr;
};

// By point; both rows null for one that stays a variable of the problem.
std::vector<CommonPlace> find_common_places(const LeastSquaresGraph& graph) {
  std::vector<CommonPlace> places(graph.points.size());
  std::vector<std::uint32_t> rows(graph.points.size(), 0);
  for (const PointRow& row : graph.point_rows) {
    CommonPlace& place = places[row.point];
    switch (rows[row.point]++) {
      case 0:
        place.first = &row;
        break;
      case 1:
        place.second = &row;
        break;
      default:
        place = {};
    }
  }
  for (CommonPlace& place : places) {
    if (place.second == nullptr || place.first->pose == place.second->pose) place = {};
  }
  return places;
}

// (WᵀW)⁻¹. REQUIRES: a regular W.
Eigen::Matrix2d covariance_of(const PointRow& row) {
  const Eigen::Matrix2d inverse = row.whitening.inverse();
  return inverse * inverse.transpose();
}

// The second row's covariance in the frame of the first row's pose.
Eigen::Matrix2d covariance_in_first(const CommonPlace& place, const std::vector<Pose2>& poses) {
  const Eigen::Matrix2d turn = rotation(poses[place.second->pose].yaw - poses[place.first->pose].yaw);
  return turn * covariance_of(*place.second) * turn.transpose();
}

// Where the rows have the point at the poses given, in the map: between the two, by their covariances, and the nearer
// to where the surer one has it the more they disagree.
Eigen::Vector2d place_in_map(const CommonPlace& place, const std::vector<Pose2>& poses, const SharedCauchyLoss& loss) {
  const Pose2& a = poses[place.first->pose];
  const Eigen::Matrix2d covariance_a = covariance_of(*place.first);
  const Eigen::Matrix2d covariance_b = covariance_in_first(place, poses);
  const Eigen::Vector2d from_b = transform(inverse(a), transform(poses[place.second->pose], place.second->measurement));
  const Eigen::Vector2d apart = from_b - place.first->measurement;
  const Eigen::Vector2d force = (covariance_a + covariance_b).inverse() * apart;
  const double share = 1.0 - loss.lean(apart.dot(force));
  const bool a_is_surer = covariance_a.determinant() <= covariance_b.determinant();
  return transform(a, a_is_surer ? Eigen::Vector2d(place.first->measurement + share * (covariance_a * force))
                                 : Eigen::Vector2d(from_b - share * (covariance_b * force)));
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
  const std::vector<CommonPlace> common = find_common_places(graph);
  const SharedCauchyLoss shared_cauchy(options.cauchy_scale);
  ceres::Problem::Options ownership;
  ownership.disable_all_safety_checks = true;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  for (auto& pose : poses) problem.AddParameterBlock(pose.data(), 3, &manifold);
  for (const PoseRow& row : graph.pose_rows) {
    problem.AddResidualBlock(new RelativePoseCost(row.measurement, row.whitening), nullptr, poses[row.from].data(),
                             poses[row.to].data());
  }
  for (const PointRow& row : graph.point_rows) {
    if (common[row.point].first != nullptr) continue;
    problem.AddResidualBlock(new LandmarkCost(row.measurement, row.whitening), &cauchy, poses[row.pose].data(),
                             points[row.point].data());
  }
  std::size_t free_points = points.size();
  std::map<std::pair<std::uint32_t, std::uint32_t>, CommonPlacesCost*> tied;  // the problem owns them
  for (const CommonPlace& place : common) {
    if (place.first == nullptr) continue;
    --free_points;
    const auto white =
        whitening(Eigen::Matrix2d(covariance_of(*place.first) + covariance_in_first(place, graph.poses)));
    if (!white) continue;
    CommonPlacesCost*& cost = tied[{place.first->pose, place.second->pose}];
    if (cost == nullptr) {
      cost = new CommonPlacesCost(shared_cauchy);
      problem.AddResidualBlock(cost, nullptr, poses[place.first->pose].data(), poses[place.second->pose].data());
    }
    cost->add(place.first->measurement, place.second->measurement, *white);
  }
  problem.SetParameterBlockConstant(poses[0].data());

  ceres::Solver::Options solver;
  solver.linear_solver_type = linear_solver(poses.size(), free_points);
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
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (common[k].first != nullptr) points[k] = place_in_map(common[k], graph.poses, shared_cauchy);
  }
  graph.points = std::move(points);
  return SolveSummary{summary.initial_cost, summary.final_cost,
                      summary.num_successful_steps + summary.num_unsuccessful_steps};
}

}  // namespace submapd::graph
