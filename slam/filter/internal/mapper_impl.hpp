// The mapper's state and steps. Steps of the filters: mapper_filters.cpp; sub-maps, key-frames, gaps: mapper_track.cpp.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/filter/axial_motion.hpp"
#include "slam/filter/internal/odometry_gate.hpp"
#include "slam/filter/internal/scan_continuity.hpp"
#include "slam/filter/internal/scan_registration.hpp"
#include "slam/filter/internal/submap_window.hpp"
#include "slam/filter/mapper.hpp"

namespace submapd {

// (H / kappa + prior)^-1 with enough on the diagonal to be invertible.
[[nodiscard]] Eigen::Matrix3d covariance_of(const Eigen::Matrix3d& information, double kappa,
                                            const Eigen::Matrix3d& prior);

// Share of a scan that fits less than usual, in slow logs: such a scan is not made part of the map.
inline constexpr double kMuchWorse = 0.12;

// One thread, but for the pool's. Public to the files of this room only.
struct Mapper::Impl {
  Impl(const MapperOptions& o, const Uuid& cart_id, const Uuid& run_id, WorkerPool& workers);

  [[nodiscard]] bool adaptive() const { return options.filter == FilterMode::kAdaptive; }
  [[nodiscard]] bool textbook() const { return options.filter == FilterMode::kFastSlam; }
  [[nodiscard]] bool slow() const { return period.usual_s() > options.low_rate_s; }
  [[nodiscard]] bool single() const { return set.size() == 1; }
  [[nodiscard]] MapView view_of(const Particle& p) const {
    const IndexMap& map = window.front().map();
    return {map, layers.view(p.layer >= 0 ? p.layer : map.layer())};
  }

  // f(particle, i) for every particle, on the pool. Each touches its own particle only: same bits for any thread count.
  template <typename F>
  void for_each_particle(F f) {
    const std::span<Particle> particles = set.particles();
    pool.run(static_cast<int>(particles.size()),
             [&](int i) { f(particles[static_cast<std::size_t>(i)], static_cast<std::uint64_t>(i)); });
  }

  // ---- sub-maps ----

  void start_in_front(const Scan& scan);
  // Nothing ties what follows to what was: a new sub-map without a link, at the predicted place.
  void break_track(const Scan& scan);
  // The front is full and the younger sub-map takes over: poses change frame.
  void hand_over(FinishReason reason);
  void hand_over_if_full();
  // The filters of fixed size never stay with one particle for long.
  void refill() {
    if (!adaptive() && single()) set.spread(options.particles, window.front().map().layer());
  }

  // ---- motion ----

  [[nodiscard]] Twist2 unwarp_twist() const { return options.unwarp ? last_twist : Twist2{}; }

  [[nodiscard]] PredictedMotion predict(const Particle& p, double step_s) const {
    if (odometry_delta) return predict_by_odometry(*odometry_delta, options.motion);
    PredictedMotion motion = predict_by_twist(p.twist, step_s, options.motion);
    if (period.bursting()) motion.delta = exp_twist(p.twist, trusted_time_s(step_s, options.motion));
    return motion;
  }

  // What predictions in a slow log are usually off; of_motion in any other.
  [[nodiscard]] Eigen::Vector3d usual_sigma(const Eigen::Vector3d& of_motion, double step_s) const {
    return slow() ? prediction_error.sigma(of_motion, step_s / period.usual_s()) : of_motion;
  }

  // The time that a motion may have taken: in a slow log a step far shorter than the usual one is a wrong stamp, by
  // which a slow turn would be one beyond any cart's.
  [[nodiscard]] double motion_time_s(double step_s) const {
    return slow() ? std::max(step_s, period.usual_s()) : step_s;
  }

  void set_prior(Particle& p, double step_s) const;

  // ---- filters ----

  // Textbook step: sample from the motion model, weigh by the particle's own map.
  void sample_motion(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) const;
  KnownFit filter_by_sampling(const Scan& scan, double step_s);
  // The improved proposal of one particle: Gaussian about the match (design notes 6.1 b).
  void apply_match(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index);
  // The walls against the scan at a pose.
  [[nodiscard]] LineSystem lines_at(const Pose2& pose, const WeakMotion& weak, LinesOf lines) const;
  // Where nothing held a weak axis for a while, or in a gap, the first thing that does is seldom within the matcher's
  // reach: of the places along it, the one whose walls hold it best, if any does; the prediction otherwise.
  [[nodiscard]] Pose2 start_along_axis(const MotionPrior& prior) const;
  // `found` is set to the last wide search's result, if one was needed.
  KnownFit filter_by_matching(const Scan& scan, double step_s, std::optional<CorrelativeResult>& found);
  // Odometry holds the direction that the walls do not, and a twist from a slow log is no match for it: no latch then.
  void watch_degeneracy(double step_s);
  // Of the particle's motion along the weak axis.
  void set_axial_speed(Particle& p, double speed_m_s) const;
  // p.twist from the motion that brought it from `from` to its pose; `before` is the twist until then.
  void learn_twist_of(Particle& p, const Twist2& before, const Pose2& from, double step_s) const;
  // Twists, for the next prediction and for unwarping this sweep once more if the first guess was off.
  void learn_motion(const Scan& scan, const Pose2& before, double step_s, bool fits);
  void note_covariance(double step_s);
  void note_fit(bool fits, double step_s);
  void normalise();
  void resample_if_needed(std::uint64_t scan_index);
  // Weighted covariance of the particles about the best, plus its own.
  [[nodiscard]] Eigen::Matrix3d posterior_covariance() const;
  // Adaptive: more than one particle only while the posterior needs it.
  void adapt(const std::optional<CorrelativeResult>& found);
  void spread_if_needed(const std::optional<CorrelativeResult>& found);

  // ---- key-frames ----

  void insert_keyframe(const Scan& scan);
  // Pose of the best particle seen from its newest key-frame.
  [[nodiscard]] Pose2 since_keyframe() const { return between(set.tree().node(set.best().node).pose, set.best().pose); }

  [[nodiscard]] bool wants_keyframe(const Scan& scan) const;
  // It fits much worse than scans have of late. In slow logs one wrong key-frame is all that the next scan has to go
  // by.
  [[nodiscard]] bool doubtful(const KnownFit& fit);

  // Makes the scan a key-frame, if the front has room for one more.
  void add_keyframe(const Scan& scan, ScanReport& report);

  // ---- after a gap ----

  // The key-frames of a finished sub-map once more, as they were.
  void insert_again(const FinishedSubmap& submap);
  void resume_after(const FinishedSubmap& last);
  // For how long nobody has known where the cart goes, if that is so: no scan came, or none that saw anything.
  [[nodiscard]] std::optional<double> gap_before(const Scan& scan) const;
  // The first scan after a gap: found again in the front, as far as the cart can have come, or a break.
  void pick_up(const Scan& scan, double gap_s, ScanReport& report, KnownFit& fit);
  // The scan, whose points are taken, is what the next one is held against.
  void note_seen(const Scan& scan);
  // The scan shows another place than the one before it did.
  [[nodiscard]] bool shows_another_place(double step_s) const;

  // ---- one scan ----

  // Everything but the first scan of a track.
  void track(const Scan& scan, double elapsed_s, ScanReport& report, KnownFit& fit);
  void fill_report(ScanReport& report, const KnownFit& fit) const;

  MapperOptions options;
  Uuid cart;
  Uuid run;
  WorkerPool& pool;
  DistanceLayers layers;
  SubmapWindow window;
  ScanRegistration registration;
  ScanContinuity continuity;
  DegeneracyMonitor degeneracy;
  AxialMotion axial;
  double axial_variance_m2 = 0.0;  // of the predicted position along the weak axis
  OdometryGate gate;
  PeriodEstimator period;
  PredictionError prediction_error;  // of slow logs without odometry
  ParticleSet set;
  std::vector<double> log_weights;
  std::vector<double> weights;
  std::vector<int> ancestors;
  double n_eff = 1.0;

  bool gap = false;  // expect_gap()
  Pose2 first_odom;  // of the next track's first sub-map, if none is open
  bool first_linked = true;
  std::optional<Pose2> odometry_delta;
  std::int64_t last_stamp_us = 0;
  std::int64_t tracked_us = 0;  // of the last scan whose place is known
  std::int64_t seen_us = 0;     // of the last scan that saw enough to be followed
  Twist2 last_twist;
  Eigen::Matrix3d last_covariance = Eigen::Matrix3d::Zero();  // without what is lost along an axis that nothing holds
  // Lost along that axis since the last key-frame: what two poses share of it is none of the step's between them.
  Eigen::Matrix2d axial_growth = Eigen::Matrix2d::Zero();
  double axial_lost_m2 = 0.0;  // until the last scan
  Eigen::Matrix3d last_keyframe_covariance = Eigen::Matrix3d::Zero();
  std::uint64_t last_keyframe_index = 0;
  std::int64_t last_keyframe_stamp_us = 0;
  bool degenerate_since_keyframe = false;
  bool was_degenerate = false;
  bool moved_since_resampling = false;
  double usual_fit = 0.0;  // matched_ratio, smoothed; 0: none yet
  int lost_scans = 0;
  double lost_time_s = 0.0;
  MapperCounters counters;
};

}  // namespace submapd
