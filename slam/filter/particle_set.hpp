// The particles of the sub-map being built, their shared past and their own distance layers (design notes 4.5, 6).
//
// A particle is a pose, a weight and a head in the ancestry tree. With one particle its map is the base map itself;
// with more, each has a copy-on-write layer of the distance field that also holds its own key-frames, and what all of
// them agree on moves into the base through `Baker`. They may differ about the newest max_scans key-frames only: the
// heaviest side of the oldest disagreement is resampled, the others die. Every store is a fixed pool: when one runs
// out, coalesce() keeps the heaviest lineage, so that the bound is exact; both events are counted.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "slam/filter/ancestry_tree.hpp"
#include "slam/grid/distance_layers.hpp"
#include "slam/grid/free_space.hpp"
#include "slam/matching/match_types.hpp"
#include "slam/scan/scan.hpp"

namespace submapd {

struct Particle {
  Pose2 pose;    // sub-map frame
  Pose2 mode;    // where the last match put it, before its pose was drawn
  Twist2 twist;  // from its own last two modes: drawn poses differ by noise, which is no motion
  double log_weight = 0.0;
  int layer = -1;     // own distance layer; -1: the base map's
  int node = 0;       // newest key-frame of its lineage
  MotionPrior prior;  // of the scan being processed
  MatchResult match;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of the pose, map frame
};

// A key-frame's scan while lineages still differ about its pose.
struct KeyframeScan {
  Scan scan;
  Twist2 twist;
  std::vector<BeamEnd> beams;  // base frame
  Eigen::Vector2f origin = Eigen::Vector2f::Zero();
  Eigen::Matrix3d step_covariance = Eigen::Matrix3d::Zero();
  bool degenerate = false;
  int references = 0;  // nodes that hold it
};

struct ParticleSetOptions {
  int max_particles = 32;
  int max_nodes = 4096;
  int max_scans = 16;  // key-frames that particles may differ about
  int max_beams = 2048;
};

class ParticleSet {
 public:
  // Puts a key-frame all particles agree on into the base map(s).
  using Baker = std::function<void(const Pose2& pose, const KeyframeScan& scan)>;

  ParticleSet(const ParticleSetOptions& options, DistanceLayers& layers, double cell_m, Baker baker);

  // One particle at the pose, no past.
  void reset(const Pose2& pose, const Twist2& twist);

  [[nodiscard]] std::span<Particle> particles() { return particles_; }
  [[nodiscard]] std::span<const Particle> particles() const { return particles_; }
  [[nodiscard]] std::size_t size() const { return particles_.size(); }
  [[nodiscard]] const Particle& best() const;
  [[nodiscard]] const AncestryTree& tree() const { return tree_; }

  // Copies the only particle to n, each with its own layer over base_layer, or fewer where layers run out. A particle
  // that stays alone keeps the base map. REQUIRES: size() == 1.
  void spread(int n, int base_layer);
  // Replaces the particles by copies of the ancestors (ascending or not) with equal weights.
  void resample(std::span<const int> ancestors);
  // Keeps the heaviest particle only and bakes its lineage.
  void coalesce();

  // Adds the key-frame of the current scan at every particle's pose, then bakes what all agree on. Coalesces first when
  // a pool is full. The lock on `scan`'s data ends with the call.
  void insert_keyframe(const Scan& scan, const Twist2& twist, std::span<const BeamEnd> beams,
                       const Eigen::Vector2f& origin, const Eigen::Matrix3d& step_covariance, bool degenerate);

  // pose <- compose(change, pose) for all poses. REQUIRES: size() == 1 and everything baked.
  void change_frame(const Pose2& change);

  // Calls visit(pose, scan) for the best particle's key-frames that are not in the base map yet, oldest first.
  void for_each_pending(const Baker& visit) const;
  // Key-frames that lineages still differ about.
  [[nodiscard]] int pending_keyframes() const { return static_cast<int>(scans_.size() - free_scans_.size()); }
  [[nodiscard]] std::uint64_t forced_coalescences() const { return forced_; }
  [[nodiscard]] std::size_t bytes_used() const;
  [[nodiscard]] std::size_t bytes_peak() const { return peak_bytes_; }
  [[nodiscard]] std::size_t bytes_limit() const;

 private:
  int take_scan_slot();
  void agree_on_oldest();
  [[nodiscard]] int oldest_of(const Particle& p) const;
  void recycle_slots();
  void bake_agreed();
  bool stamp(int layer, const Pose2& pose, const KeyframeScan& scan);

  ParticleSetOptions options_;
  DistanceLayers& layers_;
  double cells_per_m_;
  Baker baker_;
  std::vector<Particle> particles_;
  std::vector<Particle> scratch_;
  std::vector<int> copies_;
  std::vector<int> oldest_;
  std::vector<int> heirs_;
  AncestryTree tree_;
  std::vector<KeyframeScan> scans_;
  std::vector<int> free_scans_;
  std::uint64_t forced_ = 0;
  std::size_t peak_bytes_ = 0;
};

}  // namespace submapd
