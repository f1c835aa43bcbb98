#include "slam/graph/internal/consistency.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace submapd::graph {
namespace {

constexpr std::size_t kExactVertices = 60;
constexpr int kCliqueSteps = 200'000;

// Branch and bound on bit sets: extend `chosen` by members of `open` in ascending order, stop where it cannot win.
class CliqueSearch {
 public:
  explicit CliqueSearch(std::vector<std::uint64_t> neighbours) : neighbours_(std::move(neighbours)) {}

  std::uint64_t run(std::uint64_t all) {
    extend(0, all);
    return best_;
  }

 private:
  void extend(std::uint64_t chosen, std::uint64_t open) {
    if (std::popcount(chosen) > std::popcount(best_)) best_ = chosen;
    while (open != 0) {
      if (std::popcount(chosen) + std::popcount(open) <= std::popcount(best_) || ++steps_ > kCliqueSteps) return;
      const std::uint64_t lowest = open & (~open + 1);
      open &= ~lowest;
      extend(chosen | lowest, open & neighbours_[static_cast<std::size_t>(std::countr_zero(lowest))]);
    }
  }

  std::vector<std::uint64_t> neighbours_;
  std::uint64_t best_ = 0;
  int steps_ = 0;
};

std::vector<std::size_t> greedy_clique(const std::vector<std::vector<bool>>& agree) {
  std::vector<std::size_t> order(agree.size());
  std::vector<std::ptrdiff_t> degree(agree.size());
  for (std::size_t k = 0; k < agree.size(); ++k) {
    order[k] = k;
    degree[k] = std::count(agree[k].begin(), agree[k].end(), true);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return degree[i] > degree[j]; });
  std::vector<std::size_t> clique;
  for (const std::size_t k : order) {
    if (std::all_of(clique.begin(), clique.end(), [&](std::size_t m) { return agree[k][m]; })) clique.push_back(k);
  }
  std::sort(clique.begin(), clique.end());
  return clique;
}

}  // namespace

Consistency judge(const Pose2& error, const Eigen::Matrix3d& covariance, const Eigen::Vector3d& window) {
  const double gate_volume =
      4.0 / 3.0 * std::numbers::pi * std::pow(kChi2Agree, 1.5) * std::sqrt(std::max(0.0, covariance.determinant()));
  return {mahalanobis2(error, covariance), std::min(1.0, gate_volume / (8.0 * window.prod()))};
}

Consistency judge_cycle(const UncertainPose& z_ik, const UncertainPose& x_ij, const UncertainPose& z_jl,
                        const UncertainPose& x_lk, const Eigen::Vector3d& window) {
  const UncertainPose cycle = compose(compose(compose(inverse(z_ik), x_ij), z_jl), x_lk);
  return judge(cycle.mean, cycle.covariance, window);
}

std::vector<std::size_t> largest_clique(const std::vector<std::vector<bool>>& agree) {
  const std::size_t n = agree.size();
  if (n > kExactVertices) return greedy_clique(agree);
  std::vector<std::uint64_t> neighbours(n, 0);
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < n; ++i) {
    all |= std::uint64_t{1} << i;
    for (std::size_t j = 0; j < n; ++j) {
      if (i != j && agree[i][j]) neighbours[i] |= std::uint64_t{1} << j;
    }
  }
  const std::uint64_t best = CliqueSearch(std::move(neighbours)).run(all);
  std::vector<std::size_t> clique;
  for (std::size_t k = 0; k < n; ++k) {
    if ((best >> k & 1U) != 0) clique.push_back(k);
  }
  return clique;
}

}  // namespace submapd::graph
