// Correlative search over a window of poses: after gaps, at low rates, and when the gradient matcher fails (notes 5.3).
//
// Exhaustive to the cell, but branch and bound: over offsets no farther than rho cells from a centre the distance to
// the closest obstacle is at least D - rho, so that K(max(0, D - rho)) bounds the score of all of them from above. The
// bound needs no pyramid, only the field the map keeps anyway.
#pragma once

#include <span>
#include <vector>

#include "slam/grid/distance_layers.hpp"
#include "slam/matching/match_types.hpp"
#include "slam/matching/scan_points.hpp"

namespace submapd {

struct SearchWindow {
  double half_x_m = 0.3;  // map frame, about the centre
  double half_y_m = 0.3;
  double half_yaw_rad = 0.175;
  double least_score = -1.0;  // poses that score less, with what the prior takes off, are not looked at
};

struct CorrelativeOptions {
  double sigma_m = 0.075;  // of the score K = exp(-d^2 / 2 sigma^2)
  int max_points = 120;
  int max_nodes = 30000;         // coarse nodes of one search; wider windows take coarser angles
  int max_expansions = 40000;    // nodes opened for one peak: bounds the time on scans that fit nowhere
  double prior_weight = 0.05;    // score lost at the window's edge: breaks ties towards the prediction
  double second_share = 0.5;     // of the best score: what a second peak has at least
  double peak_distance_m = 0.3;  // second peak: at least this far from the first ...
  double peak_distance_rad = 0.0524;
};

struct CorrelativeResult {
  Pose2 pose;
  double score = 0.0;         // mean K in [0, 1]; 0 if no pose has the least one
  double second_score = 0.0;  // of the best pose away from the best; 0 if below its share of it
  Pose2 second_pose;
  bool complete = true;  // false: the budget ended the search, a better pose may exist
};

class CorrelativeSearch {
 public:
  explicit CorrelativeSearch(const CorrelativeOptions& options);

  [[nodiscard]] CorrelativeResult search(std::span<const ScanPoint> points, double far_range_m,
                                         const DistanceView& field, double cell_m, const Pose2& centre,
                                         const SearchWindow& window);

 private:
  struct Node {
    float bound;
    std::int16_t angle;
    std::int16_t u;  // offset of the node's first cell
    std::int16_t v;
  };
  struct Leaf {
    float score = -1.0F;
    int angle = 0;
    int u = 0;
    int v = 0;
  };
  void rotate(int angle);
  [[nodiscard]] float score(const DistanceView& field, int u, int v, std::size_t level, float least) const;
  [[nodiscard]] float penalty(int angle, int u, int v, int side) const;
  void descend(const DistanceView& field, int u, int v, std::size_t level, int angle, Leaf& best, const Leaf* apart);
  [[nodiscard]] bool near_peak(const Leaf& peak, int angle, int u, int v, int side) const;
  Leaf best_leaf(const DistanceView& field, float at_least, const Leaf* apart);

  CorrelativeOptions options_;
  std::vector<Eigen::Vector2f> points_;
  std::vector<CellIndex> cells_;  // of the points at the current angle, offset zero
  std::vector<Node> nodes_;
  std::array<std::array<float, kDistanceFar + 1>, 4> table_{};  // K bounds for blocks of 1, 2, 4, 8 cells
  double table_cell_m_ = 0.0;
  Pose2 centre_;
  double cell_m_ = 0.05;
  double yaw_step_rad_ = 0.01;
  int angles_ = 0;  // half count
  int half_u_ = 0;
  int half_v_ = 0;
  int expansions_left_ = 0;
  int peak_cells_ = 0;
  int peak_angles_ = 0;
};

}  // namespace submapd
