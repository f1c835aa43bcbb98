// The front end: scans in, poses and finished sub-maps out (paper 2.1.1; design notes 3, 5-7).
//
// One mapper per run, called from one thread; process() is the real-time path and does not allocate. has_finished() and
// take_finished() may be called by one other thread meanwhile, which then pays for the copy. Two sub-maps are active at
// a time and share every key-frame: the scan is matched against the older (the front), and when that is full the
// younger takes its place, having half of its length mapped already. Poses inside are in the front sub-map's frame; the
// "odom" frame strings the sub-maps together and is continuous but for breaks.
//
// Three filters (paper eq. (1)-(2), design notes 6): kAdaptive keeps one particle and spreads where a
// second place is nearly as likely; kRbpf keeps a fixed number with the improved proposal; kFastSlam is grid-based
// FastSLAM as in textbooks: sample motion, weigh by the particle's own map, update it, resampling wheel.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "slam/base/worker_pool.hpp"
#include "slam/filter/axial_motion.hpp"
#include "slam/filter/degeneracy.hpp"
#include "slam/filter/motion_model.hpp"
#include "slam/filter/particle_set.hpp"
#include "slam/matching/correlative_search.hpp"
#include "slam/matching/scan_matcher.hpp"
#include "slam/submap/active_submap.hpp"

namespace submapd {

enum class FilterMode : std::uint8_t { kAdaptive, kRbpf, kFastSlam };
enum class OdometryUse : std::uint8_t { kAuto, kUse, kIgnore };

struct MapperOptions {
  FilterMode filter = FilterMode::kAdaptive;
  OdometryUse odometry = OdometryUse::kAuto;
  int particles = 30;  // of kRbpf and kFastSlam
  int max_adaptive_particles = 32;
  std::uint64_t seed = 1;
  double keyframe_m = 0.15;
  double keyframe_rad = 0.0524;   // 3 deg
  double keyframe_s = 1.0;        // with at least a little motion
  double low_rate_s = 0.06;       // slower logs without odometry are searched, not only descended
  double covariance_kappa = 2.0;  // neighbouring beams are correlated: H / kappa is what is known
  double collapse_m = 0.02;       // particles closer together than this ...
  double collapse_rad = 0.0052;   // ... and this become one again
  double ambiguous_ratio = 0.85;  // second peak over first: spread particles
  bool unwarp = true;             // [experiment]: off shows what the sweep costs
  int max_beams = 2048;
  int distance_planes = 4000;  // 4 kB each, all layers together
  IndexMapOptions map;
  SubmapLimits limits;
  ScanPointOptions points;
  ScanMatcherOptions matcher;
  MotionModelOptions motion;
  CorrelativeOptions search;
  DegeneracyOptions degeneracy;
  AxialMotionOptions axial;
  LikelihoodOptions likelihood;
};

// What became of one scan.
struct ScanReport {
  std::uint64_t scan_index = 0;
  std::int64_t stamp_us = 0;
  std::uint32_t submap = 0;  // the front sub-map it was matched in
  Pose2 submap_from_base;    // at the scan's stamp (first beam)
  Pose2 odom_from_base;
  std::uint64_t keyframe_scan_index = 0;  // newest key-frame of the best lineage
  Pose2 keyframe_from_base;               // pose relative to it: stays true when key-frames are optimised
  // If this scan is a key-frame: its pose seen from the key-frame before it. Not linked: the first of all, or after a
  // break.
  Pose2 keyframe_step;
  bool keyframe_linked = false;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // sub-map frame
  double entropy = 0.0;                                  // of the pose posterior, nat
  int particles = 1;
  double n_eff = 1.0;
  bool keyframe = false;
  bool degenerate = false;
  bool lost = false;  // neither matched nor in new territory: pose is the prediction
  bool odometry_used = false;
  MatchHealth health;
};

struct MapperCounters {
  std::uint64_t scans = 0;
  std::uint64_t keyframes = 0;
  std::uint64_t lost_scans = 0;
  std::uint64_t searches = 0;  // correlative
  std::uint64_t breaks = 0;    // sub-maps begun without a link
  std::uint64_t forced_coalescences = 0;
  std::uint64_t pool_refusals = 0;      // cells or surfaces a full pool did not store
  std::uint64_t keyframes_refused = 0;  // scans that would have been one, but the front had no room
  bool odometry_rejected = false;       // kAuto found it inconsistent with the matches
  double degenerate_s = 0.0;
};

// Bytes of one budget class.
struct ByteBudget {
  const char* name = "";
  std::size_t used = 0;
  std::size_t peak = 0;
  std::size_t limit = 0;
};

class Mapper {
 public:
  // `pool` must outlive the mapper.
  Mapper(const MapperOptions& options, const Uuid& cart, const Uuid& run, WorkerPool& pool);
  ~Mapper();
  Mapper(const Mapper&) = delete;
  Mapper& operator=(const Mapper&) = delete;

  ScanReport process(const Scan& scan);

  // Goes on with a run whose newest finished sub-map is `last`: its key-frames are inserted again as they were, which
  // gives the younger sub-map back, too. The next scan follows its last key-frame; after a sub-map that ended its track
  // it begins another one, without a link. REQUIRES: no scan was processed, and nobody takes finished sub-maps yet.
  // Allocates.
  void resume_after(const FinishedSubmap& last);

  // Time has passed and nobody knows where the cart has been: the next scan is sought in the open sub-map, as far as
  // the cart can have come. Where it fits nowhere, or at two places, a sub-map without a link begins.
  void expect_gap();

  // The cart has not moved up to `stamp_us`, though no scan was processed: no gap.
  void stood_until(std::int64_t stamp_us);

  // Closes the open sub-map. Call once, after the last scan and after take_finished() was emptied.
  void finish_run();

  // The open sub-map as finish_run() would close it now; it stays open. Key-frames that particles still differ about
  // are the best one's and not in the cells yet. Nothing before the first scan. Between two scans; allocates.
  [[nodiscard]] std::optional<FinishedSubmap> snapshot_open() const;

  // The sub-map that process() or finish_run() just closed, if any. While it is not taken no other can close, which is
  // the only way in which the time of taking changes what is mapped. Allocates.
  [[nodiscard]] bool has_finished() const;
  [[nodiscard]] std::optional<FinishedSubmap> take_finished();

  [[nodiscard]] MapperCounters counters() const;
  [[nodiscard]] std::vector<ByteBudget> budgets() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace submapd
