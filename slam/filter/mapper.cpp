#include "slam/filter/mapper.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "slam/base/small_matrix.hpp"
#include "slam/filter/internal/odometry_gate.hpp"
#include "slam/filter/internal/relocalisation.hpp"
#include "slam/filter/internal/scan_registration.hpp"
#include "slam/filter/internal/submap_window.hpp"
#include "slam/filter/resampling.hpp"

namespace submapd {
namespace {

constexpr double kLostBreak_s = 0.6;  // this long without a match: the map goes on in a new sub-map
constexpr int kLostBreakScans = 5;
constexpr double kReunwarp_m_s = 0.05;
constexpr double kReunwarp_rad_s = 0.0524;
constexpr double kAxialLockSigma_m = 1e-4;
constexpr int kWeakScans = 10;
constexpr double kMoved_m = 0.01;  // less is standing: weights of a standing cart count the same evidence again
constexpr double kMoved_rad = 0.0087;

double entropy_of(const Eigen::Matrix3d& covariance) {
  const double det = std::max(covariance.determinant(), 1e-30);
  return 0.5 * (3.0 * std::log(2.0 * std::numbers::pi * std::numbers::e) + std::log(det));
}

// (H / kappa + prior)^-1 with enough on the diagonal to be invertible.
Eigen::Matrix3d covariance_of(const Eigen::Matrix3d& information, double kappa, const Eigen::Matrix3d& prior) {
  Eigen::Matrix3d A = information / kappa + prior;
  A.diagonal() += Eigen::Vector3d(1.0, 1.0, 1.0);  // 1 m, 1 rad: nothing is known worse than that
  return A.inverse();
}

Eigen::Matrix3d turned(const Eigen::Matrix3d& covariance, double yaw_rad) {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  turn.topLeftCorner<2, 2>() = rotation(yaw_rad);
  return turn * covariance * turn.transpose();
}

ParticleSetOptions particle_options(const MapperOptions& o) {
  ParticleSetOptions p;
  p.max_particles = std::max(o.particles, o.max_adaptive_particles);
  p.max_scans = o.limits.pending_keyframes;
  p.max_beams = o.max_beams;
  return p;
}

}  // namespace

struct Mapper::Impl {
  Impl(const MapperOptions& o, const Uuid& cart_id, const Uuid& run_id, WorkerPool& workers)
      : options(o),
        cart(cart_id),
        run(run_id),
        pool(workers),
        layers(o.distance_planes, std::max(o.particles, o.max_adaptive_particles) + 4),
        window(o.map, o.limits, layers, o.max_beams),
        registration(options),
        degeneracy(o.degeneracy),
        gate(o.motion),
        set(particle_options(o), layers, o.map.cell_m, [this](const Pose2& pose, const KeyframeScan& scan) {
          window.insert(pose, scan);
          ++counters.keyframes;
        }) {
    const auto n = static_cast<std::size_t>(std::max(o.particles, o.max_adaptive_particles));
    log_weights.reserve(n);
    weights.reserve(n);
    ancestors.reserve(n);
  }

  [[nodiscard]] bool adaptive() const { return options.filter == FilterMode::kAdaptive; }
  [[nodiscard]] bool textbook() const { return options.filter == FilterMode::kFastSlam; }
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

  void start_in_front(const Scan& scan) {
    set.reset({}, {});
    degeneracy.reset();
    last_covariance.setZero();
    last_keyframe_covariance.setZero();
    lost_scans = 0;
    lost_time_s = 0.0;
    weak_scans = 0;
    registration.assign(scan, {});
    insert_keyframe(scan);
    refill();
  }

  // Nothing ties what follows to what was: a new sub-map without a link, at the predicted place.
  void break_track(const Scan& scan) {
    set.coalesce();
    const Pose2 odom = compose(window.front().odom_from_submap(), set.best().pose);
    window.close(FinishReason::kDivergence);
    window.open_front(odom, false);
    start_in_front(scan);
    ++counters.breaks;
  }

  // The front is full and the younger sub-map takes over: poses change frame.
  void hand_over(FinishReason reason) {
    set.coalesce();
    const Pose2 back_from_front = window.hand_over(reason);
    set.change_frame(back_from_front);
    degeneracy.change_frame(back_from_front.yaw);
    last_covariance = turned(last_covariance, back_from_front.yaw);
    last_keyframe_covariance = turned(last_keyframe_covariance, back_from_front.yaw);
  }

  void hand_over_if_full() {
    FinishReason reason = FinishReason::kPath;
    const double fullness = window.front().fullness(&reason);
    const bool edge_of_span = degeneracy.active() != was_degenerate && window.younger_has(10);
    was_degenerate = degeneracy.active();
    if (!window.may_hand_over()) return;
    if (edge_of_span) {
      hand_over(FinishReason::kDegenerate);
    } else if (fullness >= 1.0 && (single() || !adaptive() || fullness >= kMostFullness)) {
      hand_over(reason);
    }
  }

  // The filters of fixed size never stay with one particle for long.
  void refill() {
    if (!adaptive() && single()) set.spread(options.particles, window.front().map().layer());
  }

  // ---- motion ----

  [[nodiscard]] Twist2 unwarp_twist() const { return options.unwarp ? last_twist : Twist2{}; }

  [[nodiscard]] PredictedMotion predict(const Particle& p, double step_s) const {
    return odometry_delta ? predict_by_odometry(*odometry_delta, options.motion)
                          : predict_by_twist(p.twist, step_s, options.motion);
  }

  void set_prior(Particle& p, double step_s) const {
    const PredictedMotion motion = predict(p, step_s);
    p.prior.pose = compose(p.pose, motion.delta);
    p.prior.information = motion_information(motion, p.prior.pose.yaw);
    if (degeneracy.active()) {
      // The prediction rules along the axis that no wall holds; heading and the other direction stay free.
      const Eigen::Vector2d a = degeneracy.axis();
      p.prior.information.topLeftCorner<2, 2>() += a * a.transpose() / (kAxialLockSigma_m * kAxialLockSigma_m);
    }
  }

  // ---- filters ----

  // Textbook step: sample from the motion model, weigh by the particle's own map.
  void sample_motion(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) const {
    const PredictedMotion motion = predict(p, step_s);
    CounterRandom random(options.seed, scan_index, index);
    Pose2 delta = motion.delta;
    delta.x += motion.sigma(0) * random.gaussian();
    delta.y += motion.sigma(1) * random.gaussian();
    delta.yaw += motion.sigma(2) * random.gaussian();
    p.pose = compose(p.pose, delta);
    p.log_weight += registration.log_likelihood(view_of(p), p.pose);
  }

  KnownFit filter_by_sampling(const Scan& scan, double step_s) {
    for_each_particle([&](Particle& p, std::uint64_t i) { sample_motion(p, step_s, scan.index, i); });
    normalise();
    return registration.fit(view_of(set.best()), set.best().pose);
  }

  // The improved proposal of one particle: Gaussian about the match (design notes 6.1 b).
  void apply_match(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) {
    p.covariance = covariance_of(p.match.information, options.covariance_kappa, p.prior.information);
    const Pose2 mode = p.match.pose;
    const Pose2 last_mode = std::exchange(p.mode, mode);
    if (single()) {
      p.pose = mode;
      return;
    }
    p.log_weight += registration.log_posterior(view_of(p), mode, p.prior) +
                    0.5 * std::log(std::max(p.prior.information.determinant(), 1e-30)) +
                    0.5 * std::log(std::max(p.covariance.determinant(), 1e-30));
    p.twist = learn_twist(p.twist, between(last_mode, mode), step_s, options.motion);
    if (adaptive()) {
      p.pose = mode;  // its particles are few and stand for places, not for the noise about one place
      return;
    }
    CounterRandom random(options.seed, scan_index, index);
    const Eigen::Matrix3d root = cholesky_root(p.covariance);
    // One by one: in what order the arguments of a call are drawn depends on the compiler.
    Eigen::Vector3d z;
    for (const int axis : {2, 1, 0}) z(axis) = random.gaussian();
    const Eigen::Vector3d d = root * z;
    p.pose = {mode.x + d(0), mode.y + d(1), mode.yaw + d(2)};
  }

  // `found` is set to the last wide search's result, if one was needed.
  KnownFit filter_by_matching(const Scan& scan, double step_s, std::optional<CorrelativeResult>& found) {
    const bool low_rate = period.median_s() > options.low_rate_s;
    watch_degeneracy(step_s, low_rate);
    for_each_particle([&](Particle& p, std::uint64_t) {
      set_prior(p, step_s);
      p.match = registration.match(view_of(p), p.prior.pose, p.prior);
    });
    // Serial: the search has one scratch store.
    KnownFit fit;
    const bool search_anyway = low_rate && !odometry_delta && single();
    for (Particle& p : set.particles()) {
      KnownFit own = registration.fit(view_of(p), p.match.pose);
      if (!registration.blind() && (!registration.acceptable(own) || search_anyway)) {
        const double widen = 1.0 + static_cast<double>(std::min(lost_scans, 6)) * 0.5;
        found = registration.search_about(view_of(p), p, predict(p, step_s).sigma, widen);
        ++counters.searches;
        own = registration.fit(view_of(p), p.match.pose);
      }
      if (!registration.acceptable(own)) p.match.pose = p.prior.pose;
      if (&p == &set.particles().front() || own.matched_ratio > fit.matched_ratio) fit = own;
    }
    for_each_particle([&](Particle& p, std::uint64_t i) { apply_match(p, step_s, scan.index, i); });
    normalise();
    return fit;
  }

  // Odometry holds the direction that the walls do not, and a twist from a slow log is no match for it: no latch then.
  void watch_degeneracy(double step_s, bool low_rate) {
    if (odometry_delta || low_rate) {
      degeneracy.reset();
    } else if (single()) {
      const Particle& p = set.best();
      const Pose2 predicted = compose(p.pose, predict(p, step_s).delta);
      const LineSystem system = line_system(registration.points().thinned(), window.front().map().surface(),
                                            registration.points().angle_step_rad(), predicted, options.matcher.lines);
      degeneracy.update(system.equations.H, system.associated, step_s);
    }
  }

  // Twists, for the next prediction and for unwarping this sweep once more if the first guess was off.
  void learn_motion(const Scan& scan, const Pose2& before, double step_s, bool fits) {
    const Pose2 delta = between(before, set.best().pose);
    const Twist2 last = unwarp_twist();
    if (textbook()) {
      const Twist2 common = learn_twist(last_twist, delta, step_s, options.motion);
      for (Particle& p : set.particles()) p.twist = common;
    } else if (single()) {
      Particle& p = set.particles()[0];
      const Twist2 twist_before = p.twist;
      p.twist = learn_twist(twist_before, delta, step_s, options.motion);
      const bool off = std::hypot(p.twist.vx - last.vx, p.twist.vy - last.vy) > kReunwarp_m_s ||
                       std::abs(p.twist.wz - last.wz) > kReunwarp_rad_s;
      if (off && fits && options.unwarp && scan.geometry.sweep_s > 0.0) {
        registration.assign(scan, p.twist);
        p.match = registration.match(view_of(p), p.pose, p.prior);
        apply_match(p, step_s, scan.index, 0);
        p.twist = learn_twist(twist_before, between(before, p.pose), step_s, options.motion);
      }
    }
    last_twist = set.best().twist;
    if (std::hypot(delta.x, delta.y) > kMoved_m || std::abs(delta.yaw) > kMoved_rad) moved_since_resampling = true;
    if (odometry_delta && options.odometry == OdometryUse::kAuto && fits) gate.judge(*odometry_delta, delta);
  }

  void note_covariance(double step_s) {
    last_covariance = posterior_covariance();
    if (!degeneracy.active()) return;
    const Eigen::Vector2d a = degeneracy.axis();
    last_covariance.topLeftCorner<2, 2>() += degeneracy.axial_variance_m2() * a * a.transpose();
    counters.degenerate_s += step_s;
    degenerate_since_keyframe = true;
  }

  void note_fit(bool fits, double step_s) {
    if (fits) {
      lost_scans = 0;
      lost_time_s = 0.0;
      return;
    }
    ++lost_scans;
    ++counters.lost_scans;
    lost_time_s += step_s;
    if (lost_time_s <= options.motion.max_extrapolation_s) return;
    for (Particle& p : set.particles()) p.twist = {};
    last_twist = {};
  }

  void normalise() {
    log_weights.clear();
    for (const Particle& p : set.particles()) log_weights.push_back(p.log_weight);
    weights.resize(log_weights.size());
    n_eff = normalise_weights(log_weights, weights);
    const double top = *std::max_element(log_weights.begin(), log_weights.end());
    for (Particle& p : set.particles()) p.log_weight -= top;
  }

  void resample_if_needed(std::uint64_t scan_index) {
    if (single() || !moved_since_resampling) return;
    if (!textbook() && n_eff >= 0.5 * static_cast<double>(set.size())) return;
    CounterRandom random(options.seed, scan_index, ~0ULL);
    ancestors.resize(set.size());
    textbook() ? resample_wheel(weights, random, ancestors) : resample_systematic(weights, random, ancestors);
    set.resample(ancestors);
    moved_since_resampling = false;
  }

  // Weighted covariance of the particles about the best, plus its own.
  [[nodiscard]] Eigen::Matrix3d posterior_covariance() const {
    Eigen::Matrix3d sum = set.best().covariance;
    if (single()) return sum;
    const Pose2 centre = set.best().pose;
    for (std::size_t i = 0; i < set.size() && i < weights.size(); ++i) {
      const Pose2& x = set.particles()[i].pose;
      const Eigen::Vector3d d(x.x - centre.x, x.y - centre.y, wrap_angle(x.yaw - centre.yaw));
      sum += weights[i] * d * d.transpose();
    }
    return sum;
  }

  // Adaptive: more than one particle only while the posterior needs it.
  void adapt(const std::optional<CorrelativeResult>& found, std::uint64_t scan_index) {
    if (single()) {
      spread_if_needed(found, scan_index);
      return;
    }
    // One Gaussian says as much once the particles lie no farther apart than each of them is uncertain.
    const Eigen::Matrix3d& own = set.best().covariance;
    const Eigen::Matrix3d spread = posterior_covariance() - own;
    const double limit_m2 = std::max(options.collapse_m * options.collapse_m, 2.0 * own.topLeftCorner<2, 2>().trace());
    const double limit_rad2 = std::max(options.collapse_rad * options.collapse_rad, 2.0 * own(2, 2));
    if (spread.topLeftCorner<2, 2>().trace() < limit_m2 && spread(2, 2) < limit_rad2) set.coalesce();
  }

  void spread_if_needed(const std::optional<CorrelativeResult>& found, std::uint64_t scan_index) {
    const std::optional<Pose2> other_place =
        found ? registration.second_place(view_of(set.best()), set.best(), *found) : std::nullopt;
    weak_scans = degeneracy.active() ? weak_scans + 1 : 0;
    if (!other_place && weak_scans <= kWeakScans) return;
    weak_scans = 0;
    const double axial = std::min(std::sqrt(degeneracy.axial_variance_m2()), 0.5);
    if (!other_place && axial < options.collapse_m) return;
    const int wanted =
        std::min(std::max(static_cast<int>(std::ceil(6.0 * axial / 0.1)), 8), options.max_adaptive_particles);
    set.spread(wanted, window.front().map().layer());
    for (std::size_t i = 1; i < set.size(); ++i) {
      Particle& p = set.particles()[i];
      if (other_place && i % 2 == 1) p.pose = *other_place;
      if (degeneracy.active()) {
        CounterRandom random(options.seed + 1, scan_index, i);
        const Eigen::Vector2d along = axial * random.gaussian() * degeneracy.axis();
        p.pose.x += along.x();
        p.pose.y += along.y();
      }
      p.mode = p.pose;
    }
    normalise();
  }

  // ---- key-frames ----

  void insert_keyframe(const Scan& scan) {
    const Pose2 before = set.tree().node(set.best().node).pose;
    // Both ends were matched to the same map: the step is as uncertain as the two matches.
    const Eigen::Matrix3d step = turned(last_keyframe_covariance + last_covariance, -before.yaw);
    last_keyframe_covariance = last_covariance;
    set.insert_keyframe(scan, unwarp_twist(), registration.points().beams(), registration.points().origin(), step,
                        degenerate_since_keyframe);
    degenerate_since_keyframe = degeneracy.active();
    last_keyframe_index = scan.index;
    last_keyframe_stamp_us = scan.stamp_us;
  }

  // Pose of the best particle seen from its newest key-frame.
  [[nodiscard]] Pose2 since_keyframe() const { return between(set.tree().node(set.best().node).pose, set.best().pose); }

  [[nodiscard]] bool wants_keyframe(const Scan& scan) const {
    if (window.room() <= set.pending_keyframes()) return false;  // nobody took the last finished sub-map yet
    const Pose2 step = since_keyframe();
    const double distance = std::hypot(step.x, step.y);
    if (distance > options.keyframe_m || std::abs(step.yaw) > options.keyframe_rad) return true;
    const double waited_s = static_cast<double>(scan.stamp_us - last_keyframe_stamp_us) * 1e-6;
    return waited_s > options.keyframe_s &&
           (distance > 0.1 * options.keyframe_m || std::abs(step.yaw) > 0.2 * options.keyframe_rad);
  }

  // ---- after a gap ----

  // The key-frames of a finished sub-map once more, as they were.
  void insert_again(const FinishedSubmap& submap) {
    KeyframeScan kept;
    for (const Keyframe& k : submap.keyframes) {
      if (window.room() <= 0) return;  // made with larger limits
      kept.scan = Scan{k.stamp_us, k.scan_index, k.geometry, k.ranges_mm, {}};
      registration.assign(kept.scan, k.twist);
      kept.twist = k.twist;
      kept.beams = registration.points().beams();
      kept.origin = registration.points().origin();
      kept.step_covariance = k.step_covariance;
      kept.degenerate = k.degenerate;
      window.insert(k.pose, kept);
    }
  }

  void resume_after(const FinishedSubmap& last) {
    window.count_from(last.id.index);
    window.open_front(last.odom_from_submap, last.linked_to_previous);
    insert_again(last);
    const Keyframe& newest = last.keyframes.back();
    last_stamp_us = tracked_us = newest.stamp_us;
    last_keyframe_index = newest.scan_index;
    last_keyframe_stamp_us = newest.stamp_us;
    last_twist = newest.twist;
    set.reset(newest.pose, newest.twist);
    const bool track_ended = last.reason == FinishReason::kDivergence || last.reason == FinishReason::kEndOfRun ||
                             last.reason == FinishReason::kCommand;
    if (!track_ended && window.may_hand_over()) {
      hand_over(last.reason);
      refill();
    } else {
      first_odom = compose(last.odom_from_submap, newest.pose);
      first_linked = false;
      window.close(last.reason);
    }
    (void)window.take_finished(cart, run);  // it is in the archive
  }

  // The first scan after a gap.
  void pick_up(const Scan& scan, double gap_s, ScanReport& report, KnownFit& fit) {
    registration.assign(scan, {});
    if (registration.blind() || !window.may_close()) {  // a place may not be found, and then the front is closed
      report.lost = true;
      ++counters.lost_scans;
      return;
    }
    set.coalesce();
    degeneracy.reset();
    gap = false;
    Particle& p = set.particles()[0];
    const MapView view = view_of(p);
    const std::optional<MatchResult> found = relocalise(registration, options, view, p.pose, gap_s);
    last_twist = p.twist = {};
    if (!found) {
      break_track(scan);
      report.keyframe = true;
      return;
    }
    p.match = *found;
    p.pose = p.mode = found->pose;
    p.covariance = last_covariance =
        covariance_of(found->information, options.covariance_kappa, Eigen::Matrix3d::Zero());
    fit = registration.fit(view, p.pose);
    lost_scans = 0;
    lost_time_s = 0.0;
    if (window.room() > set.pending_keyframes()) {
      report.keyframe_step = since_keyframe();
      report.keyframe_linked = true;
      report.keyframe = true;
      insert_keyframe(scan);
    }
    refill();
  }

  // ---- one scan ----

  // Everything but the first scan of a track.
  void track(const Scan& scan, double elapsed_s, ScanReport& report, KnownFit& fit) {
    period.add(elapsed_s);
    const double step_s = std::max(elapsed_s, period.median_s());
    registration.assign(scan, unwarp_twist());
    const Pose2 before = set.best().pose;
    std::optional<CorrelativeResult> found;
    fit = textbook() ? filter_by_sampling(scan, step_s) : filter_by_matching(scan, step_s, found);
    // The textbook's filter trusts its motion model: it neither loses its track nor starts anew.
    const bool fits = textbook() ? !registration.blind() : registration.acceptable(fit);
    learn_motion(scan, before, step_s, fits);
    note_covariance(step_s);
    note_fit(fits, step_s);
    resample_if_needed(scan.index);
    if (adaptive()) adapt(found, scan.index);

    report.lost = !fits;
    const bool given_up = lost_scans >= kLostBreakScans && lost_time_s > kLostBreak_s;
    if (given_up && !registration.blind() && window.may_close()) {
      break_track(scan);
      report.keyframe = true;
    } else if (fits && wants_keyframe(scan)) {
      report.keyframe_step = since_keyframe();
      report.keyframe_linked = true;
      report.keyframe = true;
      insert_keyframe(scan);
    }
  }

  void fill_report(ScanReport& report, const KnownFit& fit) const {
    const Particle& best = set.best();
    report.submap = window.front().index();
    report.submap_from_base = best.pose;
    report.odom_from_base = compose(window.front().odom_from_submap(), best.pose);
    report.keyframe_scan_index = last_keyframe_index;
    report.keyframe_from_base = since_keyframe();
    report.covariance = last_covariance;
    report.entropy = entropy_of(last_covariance);
    report.particles = static_cast<int>(set.size());
    report.n_eff = single() ? 1.0 : n_eff;
    report.degenerate = degeneracy.active();
    report.odometry_used = odometry_delta.has_value();
    report.health = best.match.health;
    report.health.matched_ratio = fit.matched_ratio;
    report.health.contradiction = fit.contradiction;
  }

  MapperOptions options;
  Uuid cart;
  Uuid run;
  WorkerPool& pool;
  DistanceLayers layers;
  SubmapWindow window;
  ScanRegistration registration;
  DegeneracyMonitor degeneracy;
  OdometryGate gate;
  PeriodEstimator period;
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
  Twist2 last_twist;
  Eigen::Matrix3d last_covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d last_keyframe_covariance = Eigen::Matrix3d::Zero();
  std::uint64_t last_keyframe_index = 0;
  std::int64_t last_keyframe_stamp_us = 0;
  bool degenerate_since_keyframe = false;
  bool was_degenerate = false;
  bool moved_since_resampling = false;
  int lost_scans = 0;
  double lost_time_s = 0.0;
  int weak_scans = 0;
  MapperCounters counters;
};

Mapper::Mapper(const MapperOptions& options, const Uuid& cart, const Uuid& run, WorkerPool& pool)
    : impl_(std::make_unique<Impl>(options, cart, run, pool)) {}
Mapper::~Mapper() = default;

ScanReport Mapper::process(const Scan& scan) {
  Impl& m = *impl_;
  ++m.counters.scans;
  const double elapsed_s = static_cast<double>(scan.stamp_us - m.last_stamp_us) * 1e-6;
  m.last_stamp_us = scan.stamp_us;
  ScanReport report;
  report.scan_index = scan.index;
  report.stamp_us = scan.stamp_us;
  const std::optional<Pose2> by_odometry = m.gate.motion(scan.odometry);
  m.odometry_delta = m.options.odometry == OdometryUse::kIgnore ? std::nullopt : by_odometry;
  KnownFit fit;
  const double gap_s = m.gap ? static_cast<double>(scan.stamp_us - m.tracked_us) * 1e-6 : 0.0;
  if (m.window.is_open() && gap_s > m.options.motion.max_extrapolation_s) {
    m.pick_up(scan, gap_s, report, fit);
  } else if (m.window.is_open()) {
    m.gap = false;
    m.track(scan, elapsed_s, report, fit);
  } else {
    m.window.open_front(m.first_odom, m.first_linked);
    m.gap = false;
    m.start_in_front(scan);
    report.keyframe = true;
  }
  if (!report.lost) m.tracked_us = scan.stamp_us;
  m.fill_report(report, fit);
  m.hand_over_if_full();
  m.refill();
  return report;
}

void Mapper::resume_after(const FinishedSubmap& last) {
  impl_->resume_after(last);
}

void Mapper::expect_gap() {
  impl_->gap = true;
}

void Mapper::finish_run() {
  Impl& m = *impl_;
  if (!m.window.is_open() || !m.window.may_close()) return;
  m.set.coalesce();
  m.window.close(FinishReason::kEndOfRun);
}

std::optional<FinishedSubmap> Mapper::snapshot_open() const {
  const Impl& m = *impl_;
  if (!m.window.is_open()) return std::nullopt;
  FinishedSubmap open = m.window.front().freeze(m.cart, m.run, FinishReason::kEndOfRun);
  m.set.for_each_pending([&open](const Pose2& pose, const KeyframeScan& kept) {
    open.keyframes.push_back({kept.scan.index, kept.scan.stamp_us, pose, kept.twist, kept.step_covariance,
                              kept.degenerate, kept.scan.geometry, kept.scan.ranges_mm});
  });
  return open;
}

bool Mapper::has_finished() const {
  return impl_->window.has_finished();
}

std::optional<FinishedSubmap> Mapper::take_finished() {
  return impl_->window.take_finished(impl_->cart, impl_->run);
}

MapperCounters Mapper::counters() const {
  MapperCounters c = impl_->counters;
  c.forced_coalescences = impl_->set.forced_coalescences();
  c.pool_refusals = impl_->window.pool_refusals();
  c.odometry_rejected = impl_->gate.rejected();
  return c;
}

std::vector<ByteBudget> Mapper::budgets() const {
  const Impl& m = *impl_;
  return {{"active_maps", m.window.bytes_used(), m.window.bytes_peak(), m.window.bytes_limit()},
          {"distance_layers", m.layers.bytes_used(), m.layers.bytes_peak(), m.layers.bytes_limit()},
          {"particles", m.set.bytes_used(), m.set.bytes_peak(), m.set.bytes_limit()}};
}

}  // namespace submapd
