#include "slam/matching/correlative_search.hpp"

#include <algorithm>
#include <cmath>

namespace submapd {
namespace {

constexpr std::size_t kTopLevel = 3;
constexpr float kAny = 0.0F;  // no mean of K is below it

constexpr int side_of(std::size_t level) {
  return 1 << level;
}

}  // namespace

CorrelativeSearch::CorrelativeSearch(const CorrelativeOptions& options) : options_(options) {
  points_.reserve(static_cast<std::size_t>(options.max_points) + 1);
  cells_.reserve(static_cast<std::size_t>(options.max_points) + 1);
  nodes_.reserve(static_cast<std::size_t>(options.max_nodes));
}

void CorrelativeSearch::rotate(int angle) {
  const double yaw = centre_.yaw + angle * yaw_step_rad_;
  const double c = std::cos(yaw);
  const double s = std::sin(yaw);
  cells_.clear();
  for (const Eigen::Vector2f& p : points_) {
    const auto x = static_cast<double>(p.x());
    const auto y = static_cast<double>(p.y());
    cells_.push_back(cell_at(centre_.x + c * x - s * y, centre_.y + s * x + c * y, 1.0 / cell_m_));
  }
}

// Mean of K over the points for the node whose offsets are [u, u + side) x [v, v + side): an upper bound, exact at
// level 0. Where a part of the points shows that it is below `least`, so is what is returned.
float CorrelativeSearch::score(const DistanceView& field, int u, int v, std::size_t level, float least) const {
  constexpr std::size_t kBunch = 8;
  const auto& table = table_[level];
  const int half = side_of(level) / 2;  // the node's centre; its offsets are within (side / 2) * sqrt(2) of it
  const auto n = static_cast<float>(cells_.size());
  float sum = 0.0F;
  for (std::size_t i = 0; i < cells_.size();) {
    const std::size_t end = std::min(i + kBunch, cells_.size());
    for (; i < end; ++i) sum += table[field.at({cells_[i].ix + u + half, cells_[i].iy + v + half})];
    const float at_most = sum + static_cast<float>(cells_.size() - i);
    if (at_most < least * n) return at_most / n;
  }
  return sum / n;
}

// Smallest loss to the motion prior over the node.
float CorrelativeSearch::penalty(int angle, int u, int v, int side) const {
  const auto nearest = [side](int low) { return low > 0 ? low : std::min(0, low + side - 1); };
  const auto share = [](int value, int half) { return half > 0 ? static_cast<double>(value) / half : 0.0; };
  const double su = share(nearest(u), half_u_);
  const double sv = share(nearest(v), half_v_);
  const double sa = share(angle, angles_);
  return static_cast<float>(options_.prior_weight * (su * su + sv * sv + sa * sa) / 3.0);
}

bool CorrelativeSearch::near_peak(const Leaf& peak, int angle, int u, int v, int side) const {
  return std::abs(angle - peak.angle) <= peak_angles_ && std::abs(u - peak.u) <= peak_cells_ &&
         std::abs(u + side - 1 - peak.u) <= peak_cells_ && std::abs(v - peak.v) <= peak_cells_ &&
         std::abs(v + side - 1 - peak.v) <= peak_cells_;
}

void CorrelativeSearch::descend(const DistanceView& field, int u, int v, std::size_t level, int angle, Leaf& best,
                                const Leaf* apart) {
  if (--expansions_left_ < 0) return;
  struct Child {
    float bound;
    int u;
    int v;
  };
  const int side = side_of(level - 1);
  std::array<Child, 4> children{};
  std::size_t n = 0;
  for (int k = 0; k < 4; ++k) {
    const int cu = u + (k & 1) * side;
    const int cv = v + (k >> 1) * side;
    if (cu > half_u_ || cv > half_v_) continue;
    if (apart != nullptr && near_peak(*apart, angle, cu, cv, side)) continue;
    const float bound = score(field, cu, cv, level - 1, kAny) - penalty(angle, cu, cv, side);
    if (bound <= best.score) continue;
    children[n++] = {bound, cu, cv};
  }
  std::stable_sort(children.begin(), children.begin() + static_cast<std::ptrdiff_t>(n),
                   [](const Child& a, const Child& b) { return a.bound > b.bound; });
  for (std::size_t k = 0; k < n; ++k) {
    if (children[k].bound <= best.score) break;
    if (level == 1) {
      best = {children[k].bound, angle, children[k].u, children[k].v};
    } else {
      descend(field, children[k].u, children[k].v, level - 1, angle, best, apart);
    }
  }
}

CorrelativeSearch::Leaf CorrelativeSearch::best_leaf(const DistanceView& field, float at_least, const Leaf* apart) {
  Leaf best;
  best.score = at_least;
  expansions_left_ = options_.max_expansions;
  int rotated = angles_ + 1;  // no angle
  for (const Node& node : nodes_) {
    if (node.bound <= best.score || expansions_left_ < 0) break;  // sorted
    if (apart != nullptr && near_peak(*apart, node.angle, node.u, node.v, side_of(kTopLevel))) continue;
    if (node.angle != rotated) {
      rotate(node.angle);
      rotated = node.angle;
    }
    descend(field, node.u, node.v, kTopLevel, node.angle, best, apart);
  }
  return best;
}

CorrelativeResult CorrelativeSearch::search(std::span<const ScanPoint> points, double far_range_m,
                                            const DistanceView& field, double cell_m, const Pose2& centre,
                                            const SearchWindow& window) {
  CorrelativeResult result;
  result.pose = result.second_pose = centre;
  if (points.empty()) return result;
  centre_ = centre;
  cell_m_ = cell_m;
  if (table_cell_m_ != cell_m) {
    table_cell_m_ = cell_m;
    for (std::size_t level = 0; level < table_.size(); ++level) {
      const double rho = level == 0 ? 0.0 : std::sqrt(2.0) * side_of(level) / 2.0;
      for (std::size_t i = 0; i <= kDistanceFar; ++i) {
        // Both bytes are rounded to the nearest 1/8 cell, the centre's and the offset's: the bound allows for a unit
        // more.
        const double units = static_cast<double>(i) - (level == 0 ? 0.0 : 1.0);
        const double d = std::max(units / kDistanceUnitsPerCell - rho, 0.0) * cell_m;
        table_[level][i] = static_cast<float>(std::exp(-0.5 * d * d / (options_.sigma_m * options_.sigma_m)));
      }
    }
  }
  points_.clear();
  const std::size_t stride = (points.size() + static_cast<std::size_t>(options_.max_points) - 1) /
                             static_cast<std::size_t>(options_.max_points);
  for (std::size_t i = 0; i < points.size(); i += stride) points_.emplace_back(points[i].x, points[i].y);

  half_u_ = std::max(static_cast<int>(std::ceil(window.half_x_m / cell_m)), 1);
  half_v_ = std::max(static_cast<int>(std::ceil(window.half_y_m / cell_m)), 1);
  const int side = side_of(kTopLevel);
  const int per_angle = ((2 * half_u_ + side) / side) * ((2 * half_v_ + side) / side);
  yaw_step_rad_ = cell_m / std::max(far_range_m, 1.0);
  // Angles to either side that leave room for all their nodes: a dropped node is a pose never tried.
  const int max_angles = std::max((options_.max_nodes / per_angle - 1) / 2, 0);
  yaw_step_rad_ = std::max(yaw_step_rad_, window.half_yaw_rad / std::max(max_angles, 1));
  angles_ = std::min(static_cast<int>(std::ceil(window.half_yaw_rad / yaw_step_rad_)), max_angles);
  peak_cells_ = static_cast<int>(options_.peak_distance_m / cell_m);
  peak_angles_ = static_cast<int>(options_.peak_distance_rad / yaw_step_rad_);

  const auto least = static_cast<float>(window.least_score);
  nodes_.clear();
  for (int angle = -angles_; angle <= angles_; ++angle) {
    rotate(angle);
    for (int v = -half_v_; v <= half_v_; v += side) {
      for (int u = -half_u_; u <= half_u_; u += side) {
        if (nodes_.size() == nodes_.capacity()) break;
        const float loss = penalty(angle, u, v, side);
        const float bound = score(field, u, v, kTopLevel, least + loss) - loss;
        if (bound < least) continue;
        nodes_.push_back(
            {bound, static_cast<std::int16_t>(angle), static_cast<std::int16_t>(u), static_cast<std::int16_t>(v)});
      }
    }
  }
  std::sort(nodes_.begin(), nodes_.end(), [](const Node& a, const Node& b) {
    if (a.bound != b.bound) return a.bound > b.bound;
    if (a.angle != b.angle) return a.angle < b.angle;
    return a.v != b.v ? a.v < b.v : a.u < b.u;
  });
  const Leaf best = best_leaf(field, least, nullptr);
  result.complete = expansions_left_ >= 0;
  if (best.score <= least) return result;
  const auto pose_of = [&](const Leaf& leaf) {
    return Pose2{centre.x + leaf.u * cell_m, centre.y + leaf.v * cell_m, centre.yaw + leaf.angle * yaw_step_rad_};
  };
  result.pose = pose_of(best);
  result.score = static_cast<double>(best.score + penalty(best.angle, best.u, best.v, 1));
  const float share_of_best = std::max(static_cast<float>(options_.second_share) * best.score, least);
  const Leaf second = best_leaf(field, share_of_best, &best);
  result.complete = result.complete && expansions_left_ >= 0;
  if (second.score > share_of_best) {
    result.second_pose = pose_of(second);
    result.second_score = static_cast<double>(second.score + penalty(second.angle, second.u, second.v, 1));
  }
  return result;
}

}  // namespace submapd
