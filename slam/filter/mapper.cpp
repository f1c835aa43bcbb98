#include "slam/filter/mapper.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "slam/filter/internal/odometry_gate.hpp"
#include "slam/filter/resampling.hpp"

namespace submapd {
namespace {

constexpr double kMinKnownRatio = 0.10;    // less of the scan on known ground: new territory, nothing to contradict
constexpr std::size_t kMinPoints = 10;     // fewer: the sensor sees nothing, which is no new territory
constexpr double kGoodMatch = 0.55;        // share of the points on known ground that must fit
constexpr double kMinWindow_m = 0.3;       // correlative search: at least this far ...
constexpr double kMinWindow_rad = 0.1745;  // ... and 10 deg
constexpr double kMaxWindow_m = 1.2;
constexpr double kMaxWindow_rad = 1.2217;  // 70 deg
constexpr double kWindowSigmas = 2.5;
constexpr double kSecondPlaceLoss = 3.0;    // log posterior: less likely by more than this is no hypothesis
constexpr double kSearchedPrior_m = 0.5;    // after a search the prediction says little more
constexpr double kSearchedPrior_rad = 0.5;
constexpr double kLostBreak_s = 0.6;  // this long without a match: the map goes on in a new sub-map
constexpr int kLostBreakScans = 5;
constexpr double kReunwarp_m_s = 0.05;
constexpr double kReunwarp_rad_s = 0.0524;
constexpr double kAxialLockSigma_m = 1e-4;
constexpr double kSamePeak_m = 0.10;       // two descents that end closer than this found the same place
constexpr double kSamePeak_rad = 0.0349;
constexpr int kWeakScans = 10;

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

}  // namespace

struct Mapper::Impl {
  Impl(const MapperOptions& o, const Uuid& cart_id, const Uuid& run_id, WorkerPool& workers)
      : options(o),
        cart(cart_id),
        run(run_id),
        pool(workers),
        layers(o.distance_planes, std::max(o.particles, o.max_adaptive_particles) + 4),
        points(o.points, o.max_beams),
        search(o.search),
        likelihood(o.likelihood, o.map.cell_m),
        degeneracy(o.degeneracy),
        gate(o.motion),
        set(particle_options(o), layers, o.map.cell_m,
            [this](const Pose2& pose, const KeyframeScan& scan) { bake(pose, scan); }) {
    for (std::unique_ptr<ActiveSubmap>& s : submaps) {
      s = std::make_unique<ActiveSubmap>(o.map, o.limits, layers, o.max_beams);
    }
    front = submaps[0].get();
    back = submaps[1].get();
    spare = submaps[2].get();
    const auto n = static_cast<std::size_t>(std::max(o.particles, o.max_adaptive_particles));
    log_weights.reserve(n);
    weights.reserve(n);
    ancestors.reserve(n);
  }

  static ParticleSetOptions particle_options(const MapperOptions& o) {
    ParticleSetOptions p;
    p.max_particles = std::max(o.particles, o.max_adaptive_particles);
    p.max_beams = o.max_beams;
    return p;
  }

  [[nodiscard]] bool single() const { return set.size() == 1; }
  [[nodiscard]] DistanceView field_of(const Particle& p) const {
    return layers.view(p.layer >= 0 ? p.layer : front->map().layer());
  }

  // ---- sub-maps ----

  void open_front(const Pose2& odom_from_submap, bool linked) {
    front->open(next_index++, odom_from_submap, linked);
    front_open = true;
    back_open = false;
  }

  // Everything that is agreed on goes into both active sub-maps; the younger is opened at half time.
  void bake(const Pose2& pose, const KeyframeScan& scan) {
    front->insert(pose, scan.scan, scan.twist, scan.step_covariance, scan.degenerate, scan.beams, scan.origin);
    ++counters.keyframes;
    const Pose2 odom = compose(front->odom_from_submap(), pose);
    if (!back_open && front->keyframes() > 1 && front->fullness() >= 0.5) {
      back->open(next_index++, odom, true);
      back_open = true;
    }
    if (back_open) {
      const Pose2 in_back = between(back->odom_from_submap(), odom);
      back->insert(in_back, scan.scan, scan.twist, scan.step_covariance, scan.degenerate, scan.beams, scan.origin);
    }
  }

  void close_front(FinishReason reason) {
    finish_reason = reason;
    finished = front;
    front = spare;
    spare = finished;
    front_open = false;
  }

  // The front is full and the younger sub-map takes over: poses change frame.
  void hand_over(FinishReason reason) {
    set.coalesce();
    const Pose2 back_from_front = between(back->odom_from_submap(), front->odom_from_submap());
    close_front(reason);
    std::swap(front, back);
    front_open = true;
    back_open = false;
    set.change_frame(back_from_front);
    degeneracy.change_frame(back_from_front.yaw);
    last_covariance = turned(last_covariance, back_from_front.yaw);
    last_keyframe_covariance = turned(last_keyframe_covariance, back_from_front.yaw);
  }

  static Eigen::Matrix3d turned(const Eigen::Matrix3d& covariance, double yaw_rad) {
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() = rotation(yaw_rad);
    return turn * covariance * turn.transpose();
  }

  // Nothing ties what follows to what was: a new sub-map without a link, at the predicted place.
  void break_track(const Scan& scan, FinishReason reason) {
    set.coalesce();
    const Pose2 odom = compose(front->odom_from_submap(), set.best().pose);
    const bool front_emitted = front->keyframes() > 0;
    if (back_open) --next_index;  // the younger holds nothing that the front does not: its index is free again
    back_open = false;
    if (front_emitted) close_front(reason);
    open_front(odom, false);
    start_in_front(scan);
    ++counters.breaks;
  }

  void start_in_front(const Scan& scan) {
    set.reset({}, {});
    degeneracy.reset();
    last_covariance.setZero();
    last_keyframe_covariance.setZero();
    lost_scans = 0;
    lost_time_s = 0.0;
    weak_scans = 0;
    points.assign(scan, {});
    insert_keyframe(scan);
    if (options.filter != FilterMode::kAdaptive) set.spread(options.particles, front->map().layer());
  }

  // ---- one scan ----

  PredictedMotion predict(const Particle& p, double step_s) const {
    return odometry_delta ? predict_by_odometry(*odometry_delta, options.motion)
                          : predict_by_twist(p.twist, step_s, options.motion);
  }

  void set_prior(Particle& p, double step_s) {
    const PredictedMotion motion = predict(p, step_s);
    p.prior.pose = compose(p.pose, motion.delta);
    p.prior.information = motion_information(motion, p.prior.pose.yaw);
    if (degeneracy.active()) {
      // The prediction rules along the axis that no wall holds; heading and the other direction stay free.
      const Eigen::Vector2d a = degeneracy.axis();
      p.prior.information.topLeftCorner<2, 2>() += a * a.transpose() / (kAxialLockSigma_m * kAxialLockSigma_m);
    }
  }

  void match(Particle& p, const Pose2& start) const {
    p.match = match_scan(points, field_of(p), front->map(), start, p.prior, options.matcher);
  }

  [[nodiscard]] bool blind() const { return points.thinned().size() < kMinPoints; }
  [[nodiscard]] bool acceptable(const KnownFit& fit) const {
    return !blind() && (fit.known_ratio < kMinKnownRatio || fit.matched_ratio >= kGoodMatch);
  }

  // Log of what the map and the motion model together say about a pose, up to a constant.
  [[nodiscard]] double log_posterior(const Particle& p, const Pose2& pose, const MotionPrior& prior) const {
    const Eigen::Vector3d off(pose.x - prior.pose.x, pose.y - prior.pose.y, wrap_angle(pose.yaw - prior.pose.yaw));
    return likelihood.log_likelihood(points.thinned(), field_of(p), options.map.cell_m, pose) -
           0.5 * off.dot(prior.information * off);
  }

  // Wide search about the prediction, then both stages again; what was matched before stays if it is the likelier place.
  CorrelativeResult search_about(Particle& p, const Eigen::Vector3d& sigma) {
    SearchWindow window;
    const double widen = 1.0 + static_cast<double>(std::min(lost_scans, 6)) * 0.5;
    window.half_x_m = std::clamp(kWindowSigmas * sigma(0) * widen, kMinWindow_m, kMaxWindow_m * widen);
    window.half_y_m = window.half_x_m;
    window.half_yaw_rad = std::clamp(kWindowSigmas * sigma(2) * widen, kMinWindow_rad, kMaxWindow_rad * widen);
    const CorrelativeResult found =
        search.search(points.thinned(), points.far_range_m(), field_of(p), options.map.cell_m, p.prior.pose, window);
    ++counters.searches;
    const MatchResult descended = p.match;
    const MotionPrior motion = p.prior;
    match(p, found.pose);
    if (between(p.match.pose, found.pose).translation().norm() > kSamePeak_m) {
      // The motion model pulled it out of the place that was found: look at that place on its own.
      p.prior.pose = found.pose;
      p.prior.information =
          Eigen::Vector3d(1.0 / (kSearchedPrior_m * kSearchedPrior_m), 1.0 / (kSearchedPrior_m * kSearchedPrior_m),
                          1.0 / (kSearchedPrior_rad * kSearchedPrior_rad))
              .asDiagonal();
      match(p, found.pose);
      p.prior.pose = motion.pose;
    }
    const auto fits = [&](const Pose2& pose) {
      return acceptable(known_fit(points, field_of(p), front->map(), pose));
    };
    // A place that fits beats one that does not, however odd the motion: odometry slips. Of two that fit, the likelier.
    const bool found_fits = fits(p.match.pose);
    if (found_fits == fits(descended.pose)
            ? log_posterior(p, descended.pose, motion) >= log_posterior(p, p.match.pose, motion)
            : !found_fits) {
      p.match = descended;
      p.prior = motion;
    }
    return found;
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
    const Eigen::Vector3d off(mode.x - p.prior.pose.x, mode.y - p.prior.pose.y,
                              wrap_angle(mode.yaw - p.prior.pose.yaw));
    const double log_prior =
        -0.5 * off.dot(p.prior.information * off) + 0.5 * std::log(std::max(p.prior.information.determinant(), 1e-30));
    const double log_likelihood = likelihood.log_likelihood(points.thinned(), field_of(p), options.map.cell_m, mode);
    p.log_weight += log_likelihood + log_prior + 0.5 * std::log(std::max(p.covariance.determinant(), 1e-30));
    p.twist = learn_twist(p.twist, between(last_mode, mode), step_s, options.motion);
    if (options.filter == FilterMode::kAdaptive) {
      p.pose = mode;  // its particles are few and stand for places, not for the noise about one place
      return;
    }
    CounterRandom random(options.seed, scan_index, index);
    const Eigen::Matrix3d root = p.covariance.llt().matrixL();
    const Eigen::Vector3d z(random.gaussian(), random.gaussian(), random.gaussian());
    const Eigen::Vector3d d = root * z;
    p.pose = {mode.x + d(0), mode.y + d(1), mode.yaw + d(2)};
  }

  // Textbook step: sample from the motion model, weigh by the particle's own map.
  void sample_motion(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) const {
    const PredictedMotion motion = predict(p, step_s);
    CounterRandom random(options.seed, scan_index, index);
    Pose2 delta = motion.delta;
    delta.x += motion.sigma(0) * random.gaussian();
    delta.y += motion.sigma(1) * random.gaussian();
    delta.yaw += motion.sigma(2) * random.gaussian();
    p.pose = compose(p.pose, delta);
    p.log_weight += likelihood.log_likelihood(points.thinned(), field_of(p), options.map.cell_m, p.pose);
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
    const bool wheel = options.filter == FilterMode::kFastSlam;
    if (!moved_since_resampling || (!wheel && n_eff >= 0.5 * static_cast<double>(set.size()))) return;
    CounterRandom random(options.seed, scan_index, ~0ULL);
    ancestors.resize(set.size());
    wheel ? resample_wheel(weights, random, ancestors) : resample_systematic(weights, random, ancestors);
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

  // The search's second peak, if it is a place of its own and nearly as likely as the first: descending from it must not
  // lead to the same pose, and the motion model must allow it.
  [[nodiscard]] std::optional<Pose2> second_place(const CorrelativeResult* found) const {
    if (found == nullptr || found->second_score <= options.ambiguous_ratio * found->score) return std::nullopt;
    const Particle& p = set.best();
    MotionPrior weak = p.prior;
    weak.pose = found->second_pose;
    const Pose2 other = match_scan(points, field_of(p), front->map(), found->second_pose, weak, options.matcher).pose;
    const Pose2 apart = between(p.match.pose, other);
    if (std::hypot(apart.x, apart.y) < kSamePeak_m && std::abs(apart.yaw) < kSamePeak_rad) return std::nullopt;
    const double loss = log_posterior(p, p.match.pose, p.prior) - log_posterior(p, other, p.prior);
    return loss < kSecondPlaceLoss ? std::optional<Pose2>(other) : std::nullopt;
  }

  // Adaptive: more than one particle only while the posterior needs it.
  void adapt(const CorrelativeResult* found, std::uint64_t scan_index) {
    if (options.filter != FilterMode::kAdaptive) return;
    if (!single()) {
      // One Gaussian says as much once the particles lie no farther apart than each of them is uncertain.
      const Eigen::Matrix3d& own = set.best().covariance;
      const Eigen::Matrix3d spread = posterior_covariance() - own;
      const double limit_m2 = std::max(options.collapse_m * options.collapse_m, 2.0 * own.topLeftCorner<2, 2>().trace());
      const double limit_rad2 = std::max(options.collapse_rad * options.collapse_rad, 2.0 * own(2, 2));
      if (spread.topLeftCorner<2, 2>().trace() < limit_m2 && spread(2, 2) < limit_rad2) set.coalesce();
      return;
    }
    const std::optional<Pose2> other_place = second_place(found);
    const bool two_places = other_place.has_value();
    weak_scans = degeneracy.active() ? weak_scans + 1 : 0;
    if (!two_places && weak_scans <= kWeakScans) return;
    weak_scans = 0;
    const double axial = std::min(std::sqrt(degeneracy.axial_variance_m2()), 0.5);
    if (!two_places && axial < options.collapse_m) return;
    const int wanted = std::min(std::max(static_cast<int>(std::ceil(6.0 * axial / 0.1)), 8), options.max_adaptive_particles);
    set.spread(wanted, front->map().layer());
    for (std::size_t i = 1; i < set.size(); ++i) {
      Particle& p = set.particles()[i];
      if (two_places && i % 2 == 1) p.pose = *other_place;
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

  void insert_keyframe(const Scan& scan) {
    const Particle& best = set.best();
    const Pose2 before = set.tree().node(best.node).pose;
    // Both ends were matched to the same map: the step is as uncertain as the two matches.
    const Eigen::Matrix3d step = turned(last_keyframe_covariance + last_covariance, -before.yaw);
    last_keyframe_covariance = last_covariance;
    set.insert_keyframe(scan, unwarp_twist, points.beams(), points.origin(), step, degenerate_since_keyframe);
    degenerate_since_keyframe = degeneracy.active();
    last_keyframe_index = scan.index;
    last_keyframe_stamp_us = scan.stamp_us;
  }

  [[nodiscard]] bool wants_keyframe(const Scan& scan) const {
    const Particle& best = set.best();
    const Pose2 step = between(set.tree().node(best.node).pose, best.pose);
    const double distance = std::hypot(step.x, step.y);
    if (distance > options.keyframe_m || std::abs(step.yaw) > options.keyframe_rad) return true;
    const double waited_s = static_cast<double>(scan.stamp_us - last_keyframe_stamp_us) * 1e-6;
    return waited_s > options.keyframe_s &&
           (distance > 0.1 * options.keyframe_m || std::abs(step.yaw) > 0.2 * options.keyframe_rad);
  }

  void hand_over_if_full() {
    FinishReason reason = FinishReason::kPath;
    const double fullness = front->fullness(&reason);
    const bool edge_of_span = degeneracy.active() != was_degenerate && back_open && back->keyframes() >= 10;
    was_degenerate = degeneracy.active();
    if (finished != nullptr || !back_open) return;
    if (edge_of_span) {
      hand_over(FinishReason::kDegenerate);
    } else if (fullness >= 1.0 && (single() || options.filter != FilterMode::kAdaptive || fullness >= 1.25)) {
      hand_over(reason);
      if (options.filter != FilterMode::kAdaptive) set.spread(options.particles, front->map().layer());
    }
  }

  MapperOptions options;
  Uuid cart;
  Uuid run;
  WorkerPool& pool;
  DistanceLayers layers;
  std::array<std::unique_ptr<ActiveSubmap>, 3> submaps;
  ActiveSubmap* front = nullptr;  // matched against
  ActiveSubmap* back = nullptr;   // younger, takes over
  ActiveSubmap* spare = nullptr;  // free, or finished and not yet taken
  ActiveSubmap* finished = nullptr;
  FinishReason finish_reason = FinishReason::kPath;
  bool front_open = false;
  bool back_open = false;
  std::uint32_t next_index = 0;

  ScanPoints points;
  CorrelativeSearch search;
  LikelihoodTable likelihood;
  DegeneracyMonitor degeneracy;
  OdometryGate gate;
  PeriodEstimator period;
  ParticleSet set;
  std::vector<double> log_weights;
  std::vector<double> weights;
  std::vector<int> ancestors;
  double n_eff = 1.0;

  std::optional<Pose2> odometry_delta;
  std::int64_t last_stamp_us = 0;
  Twist2 unwarp_twist;
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
  const MapperOptions& o = m.options;
  ++m.counters.scans;
  const double elapsed_s = static_cast<double>(scan.stamp_us - m.last_stamp_us) * 1e-6;
  m.last_stamp_us = scan.stamp_us;
  ScanReport report;
  report.scan_index = scan.index;
  report.stamp_us = scan.stamp_us;
  const std::optional<Pose2> by_odometry = m.gate.motion(scan.odometry);
  m.odometry_delta = o.odometry == OdometryUse::kIgnore ? std::nullopt : by_odometry;

  bool first = !m.front_open;
  CorrelativeResult found;
  const CorrelativeResult* searched = nullptr;
  KnownFit fit;
  if (first) {
    m.open_front({}, true);
    m.start_in_front(scan);
  } else {
    m.period.add(elapsed_s);
    const double step_s = std::max(elapsed_s, m.period.median_s());
    const bool low_rate = m.period.median_s() > o.low_rate_s;
    const Twist2 before_twist = m.unwarp_twist;
    if (!o.unwarp) m.unwarp_twist = {};
    m.points.assign(scan, m.unwarp_twist);
    const Pose2 before = m.set.best().pose;

    if (o.filter == FilterMode::kFastSlam) {
      std::span<Particle> particles = m.set.particles();
      m.pool.run(static_cast<int>(particles.size()), [&](int i) {
        m.sample_motion(particles[static_cast<std::size_t>(i)], step_s, scan.index, static_cast<std::uint64_t>(i));
      });
      m.normalise();
      fit = known_fit(m.points, m.field_of(m.set.best()), m.front->map(), m.set.best().pose);
    } else {
      // Odometry holds the direction that the walls do not, and a twist from a slow log is no match for it: no latch then.
      const bool may_latch = !m.odometry_delta && !low_rate;
      if (!may_latch) m.degeneracy.reset();
      if (m.single() && may_latch) {
        const Pose2 predicted = compose(before, m.predict(m.set.best(), step_s).delta);
        const LineSystem at_prediction = line_system(m.points.thinned(), m.front->map().surface(),
                                                     m.points.angle_step_rad(), predicted, o.matcher.lines);
        m.degeneracy.update(at_prediction.equations.H, at_prediction.associated, step_s);
      }
      std::span<Particle> particles = m.set.particles();
      m.pool.run(static_cast<int>(particles.size()), [&](int i) {
        Particle& p = particles[static_cast<std::size_t>(i)];
        m.set_prior(p, step_s);
        m.match(p, p.prior.pose);
      });
      // Serial from here: the search has one scratch store.
      for (Particle& p : particles) {
        KnownFit own = known_fit(m.points, m.field_of(p), m.front->map(), p.match.pose);
        const bool search_anyway = low_rate && !m.odometry_delta && m.single();
        if (!m.blind() && (!m.acceptable(own) || search_anyway)) {
          found = m.search_about(p, m.predict(p, step_s).sigma);
          searched = &found;
          own = known_fit(m.points, m.field_of(p), m.front->map(), p.match.pose);
        }
        if (!m.acceptable(own)) p.match.pose = p.prior.pose;
        if (&p == &particles.front() || own.matched_ratio > fit.matched_ratio) fit = own;
      }
      m.pool.run(static_cast<int>(particles.size()), [&](int i) {
        m.apply_match(particles[static_cast<std::size_t>(i)], step_s, scan.index, static_cast<std::uint64_t>(i));
      });
      m.normalise();
    }

    // Twists, for the next prediction and for unwarping this sweep once more if the first guess was off.
    const Pose2 delta = between(before, m.set.best().pose);
    for (Particle& p : m.set.particles()) {
      if (o.filter != FilterMode::kFastSlam && m.single()) p.twist = learn_twist(p.twist, delta, step_s, o.motion);
    }
    if (o.filter == FilterMode::kFastSlam) {
      const Twist2 common = learn_twist(before_twist, delta, step_s, o.motion);
      for (Particle& p : m.set.particles()) p.twist = common;
    }
    Twist2 now = m.set.best().twist;
    if (o.unwarp && scan.geometry.sweep_s > 0.0 && m.single() && m.acceptable(fit) &&
        (std::hypot(now.vx - before_twist.vx, now.vy - before_twist.vy) > kReunwarp_m_s ||
         std::abs(now.wz - before_twist.wz) > kReunwarp_rad_s)) {
      Particle& p = m.set.particles()[0];
      m.points.assign(scan, now);
      m.match(p, p.pose);
      m.apply_match(p, step_s, scan.index, 0);
      p.twist = learn_twist(before_twist, between(before, p.pose), step_s, o.motion);
      now = p.twist;
    }
    m.unwarp_twist = now;

    if (std::hypot(delta.x, delta.y) > 0.01 || std::abs(delta.yaw) > 0.0087) m.moved_since_resampling = true;
    if (m.odometry_delta && o.odometry == OdometryUse::kAuto && m.acceptable(fit))
      m.gate.judge(*m.odometry_delta, delta);
    m.last_covariance = m.posterior_covariance();
    if (m.degeneracy.active()) {
      const Eigen::Vector2d a = m.degeneracy.axis();
      m.last_covariance.topLeftCorner<2, 2>() += m.degeneracy.axial_variance_m2() * a * a.transpose();
      m.counters.degenerate_s += step_s;
      m.degenerate_since_keyframe = true;
    }
    report.lost = !m.acceptable(fit);
    if (report.lost) {
      ++m.lost_scans;
      ++m.counters.lost_scans;
      m.lost_time_s += step_s;
      if (m.lost_time_s > o.motion.max_extrapolation_s) {
        for (Particle& p : m.set.particles()) p.twist = {};
        m.unwarp_twist = {};
      }
    } else {
      m.lost_scans = 0;
      m.lost_time_s = 0.0;
    }
    if (!m.single()) m.resample_if_needed(scan.index);
    m.adapt(searched, scan.index);

    const bool given_up = m.lost_scans >= kLostBreakScans && m.lost_time_s > kLostBreak_s;
    if (given_up && !m.blind() && m.finished == nullptr) {
      m.break_track(scan, FinishReason::kDivergence);
      first = true;
    } else {
      if (!report.lost && m.wants_keyframe(scan)) {
        report.keyframe_step = between(m.set.tree().node(m.set.best().node).pose, m.set.best().pose);
        report.keyframe_linked = true;
        report.keyframe = true;
        m.insert_keyframe(scan);
      }
    }
  }
  if (first) report.keyframe = true;

  const Particle& best = m.set.best();
  report.submap = m.front->index();
  report.submap_from_base = best.pose;
  report.odom_from_base = compose(m.front->odom_from_submap(), best.pose);
  report.keyframe_scan_index = m.last_keyframe_index;
  report.keyframe_from_base = between(m.set.tree().node(best.node).pose, best.pose);
  report.covariance = m.last_covariance;
  report.entropy = entropy_of(m.last_covariance);
  report.particles = static_cast<int>(m.set.size());
  report.n_eff = m.single() ? 1.0 : m.n_eff;
  report.degenerate = m.degeneracy.active();
  report.odometry_used = m.odometry_delta.has_value();
  report.health = best.match.health;
  report.health.matched_ratio = fit.matched_ratio;
  report.health.contradiction = fit.contradiction;
  m.hand_over_if_full();
  return report;
}

void Mapper::finish_run() {
  Impl& m = *impl_;
  if (!m.front_open || m.finished != nullptr) return;
  m.set.coalesce();
  m.back_open = false;  // holds nothing that the front does not
  m.close_front(FinishReason::kEndOfRun);
}

bool Mapper::has_finished() const {
  return impl_->finished != nullptr;
}

std::optional<FinishedSubmap> Mapper::take_finished() {
  Impl& m = *impl_;
  if (m.finished == nullptr) return std::nullopt;
  FinishedSubmap out = m.finished->freeze(m.cart, m.run, m.finish_reason);
  m.finished = nullptr;
  return out;
}

MapperCounters Mapper::counters() const {
  MapperCounters c = impl_->counters;
  c.forced_coalescences = impl_->set.forced_coalescences();
  for (const std::unique_ptr<ActiveSubmap>& s : impl_->submaps) {
    c.pool_refusals += s->map().refused() + s->map().surface().refused();
  }
  c.odometry_rejected = impl_->gate.rejected();
  return c;
}

std::vector<ByteBudget> Mapper::budgets() const {
  std::vector<ByteBudget> out;
  ByteBudget active{"active_maps", 0, 0, 0};
  for (const std::unique_ptr<ActiveSubmap>& s : impl_->submaps) {
    active.used += s->map().bytes_used() + s->keyframe_bytes();
    active.limit += s->map().bytes_limit() + s->keyframe_bytes();
  }
  active.peak = active.used;
  out.push_back(active);
  out.push_back(
      {"distance_layers", impl_->layers.bytes_used(), impl_->layers.bytes_peak(), impl_->layers.bytes_limit()});
  out.push_back({"particles", impl_->set.bytes_used(), impl_->set.bytes_used(), impl_->set.bytes_limit()});
  return out;
}

}  // namespace submapd
