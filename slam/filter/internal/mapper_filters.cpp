#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "slam/base/small_matrix.hpp"
#include "slam/filter/internal/mapper_impl.hpp"
#include "slam/filter/resampling.hpp"

namespace submapd {
namespace {

constexpr double kReunwarp_m_s = 0.05;
constexpr double kReunwarp_rad_s = 0.0524;
constexpr double kUnknownTurn_rad_s = 0.7;
constexpr double kShortGap_s = 0.15;  // scans are missing: a descent from the prediction may end elsewhere
constexpr int kPlaces = 2;            // a particle each
constexpr double kMoved_m = 0.01;     // less is standing: weights of a standing cart count the same evidence again
constexpr double kMoved_rad = 0.0087;
constexpr double kWithinReach_m = 0.05;  // the matcher finds a wall that is off by so much
constexpr double kSearchStep_m = 0.04;   // along an axis that nothing held
constexpr double kSearchSigmas = 2.5;
constexpr double kFarthest_m = 1.2;
constexpr double kFound = 1e4;     // information [1/m^2] of a place that is one ...
constexpr double kMuchMore = 1.5;  // ... and over that of the prediction
constexpr double kAlong = 4.0;     // square of the speed over that aside: beyond, the cart goes along the axis

// Of (x, y, yaw): in recorded logs odometry was seldom read just when the scan was taken.
const Eigen::Vector3d kOdometryStamp(0.03, 0.03, 0.03);

}  // namespace

Eigen::Matrix3d covariance_of(const Eigen::Matrix3d& information, double kappa, const Eigen::Matrix3d& prior) {
  Eigen::Matrix3d A = information / kappa + prior;
  A.diagonal() += Eigen::Vector3d(1.0, 1.0, 1.0);  // 1 m, 1 rad: nothing is known worse than that
  return A.inverse();
}

void Mapper::Impl::set_prior(Particle& p, double step_s) const {
  PredictedMotion motion = predict(p, step_s);
  if (slow())
    motion.sigma = odometry_delta ? Eigen::Vector3d(motion.sigma + kOdometryStamp) : usual_sigma(motion.sigma, step_s);
  p.prior.pose = compose(p.pose, motion.delta);
  p.prior.information = motion_information(motion, p.prior.pose.yaw);
  p.prior.weak = {};
  if (axial.cold() && !odometry_delta && step_s <= options.low_rate_s) {
    // A cart that rolls when mapping begins: nothing is known of its speed yet.
    const double sigma_m = options.axial.unknown_speed_sigma * step_s;
    const double sigma_rad = kUnknownTurn_rad_s * step_s;
    p.prior.information =
        Eigen::Vector3d(1.0 / (sigma_m * sigma_m), 1.0 / (sigma_m * sigma_m), 1.0 / (sigma_rad * sigma_rad))
            .asDiagonal();
  }
  if (!degeneracy.weak()) return;
  p.prior.weak = {degeneracy.axis(), degeneracy.turn_rad_m()};
  const Eigen::Vector2d a = degeneracy.axis();
  auto translation = p.prior.information.topLeftCorner<2, 2>();
  // The few beams that face the axis must be able to teach a new speed, which the twist's own Q would not let them. The
  // matcher takes beams for less than they are (kappa), so the prediction has to look as much less certain.
  const double ours = a.dot(translation * a);
  const double share = options.covariance_kappa / options.matcher.lines.kappa;
  translation -= a * a.transpose() * (ours - share / axial_variance_m2);
}

void Mapper::Impl::sample_motion(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) const {
  const PredictedMotion motion = predict(p, step_s);
  CounterRandom random(options.seed, scan_index, index);
  Pose2 delta = motion.delta;
  delta.x += motion.sigma(0) * random.gaussian();
  delta.y += motion.sigma(1) * random.gaussian();
  delta.yaw += motion.sigma(2) * random.gaussian();
  p.pose = compose(p.pose, delta);
  p.log_weight += registration.log_likelihood(view_of(p), p.pose);
}

KnownFit Mapper::Impl::filter_by_sampling(const Scan& scan, double step_s) {
  for_each_particle([&](Particle& p, std::uint64_t i) { sample_motion(p, step_s, scan.index, i); });
  normalise();
  return registration.fit(view_of(set.best()), set.best().pose);
}

void Mapper::Impl::apply_match(Particle& p, double step_s, std::uint64_t scan_index, std::uint64_t index) {
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
  p.twist = learn_twist(p.twist, between(last_mode, mode), motion_time_s(step_s), options.motion);
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

LineSystem Mapper::Impl::lines_at(const Pose2& pose, const WeakMotion& weak, LinesOf lines) const {
  LineMatcherOptions matcher = options.matcher.lines;
  matcher.lines = lines;
  return line_system(registration.points().thinned(), window.front().map().surface(),
                     registration.points().angle_step_rad(), pose, weak, matcher);
}

Pose2 Mapper::Impl::start_along_axis(const MotionPrior& prior) const {
  const double sigma_m = std::sqrt(axial_variance_m2);
  if (!degeneracy.weak() || sigma_m < kWithinReach_m) return prior.pose;
  const WeakMotion& weak = prior.weak;
  const auto information_at = [&](double along_m) {
    return lines_at(weak.moved(prior.pose, along_m), weak, LinesOf::kCell).axial_information;
  };
  const int steps = static_cast<int>(std::min(kSearchSigmas * sigma_m, kFarthest_m) / kSearchStep_m);
  double most = std::max(kMuchMore * information_at(0.0), kFound);
  double best_m = 0.0;
  for (int k = -steps; k <= steps; ++k) {
    const double information = information_at(k * kSearchStep_m);
    if (information <= most) continue;
    most = information;
    best_m = k * kSearchStep_m;
  }
  return weak.moved(prior.pose, best_m);
}

KnownFit Mapper::Impl::filter_by_matching(const Scan& scan, double step_s, std::optional<CorrelativeResult>& found) {
  watch_degeneracy(step_s);
  for_each_particle([&](Particle& p, std::uint64_t) {
    set_prior(p, step_s);
    p.match = registration.match(view_of(p), start_along_axis(p.prior), p.prior);
  });
  // Serial: the search has one scratch store.
  KnownFit fit;
  // Along a weak axis a search finds the place where the map ends, or another door: the cart went on.
  const bool after_gap = step_s > kShortGap_s && single() && !degeneracy.weak();
  const bool search_anyway = !odometry_delta && adaptive() && (slow() || after_gap);
  const double good = slow() && !odometry_delta ? usual_fit - kMuchWorse : 0.0;
  for (Particle& p : set.particles()) {
    KnownFit own = registration.fit(view_of(p), p.match.pose);
    if (!registration.blind() && (search_anyway || !registration.acceptable(own))) {
      const double widen = 1.0 + static_cast<double>(std::min(lost_scans, 6)) * 0.5;
      const auto search = [&](const Eigen::Vector3d& sigma) {
        found = registration.search_about(view_of(p), p, sigma, widen, good);
        ++counters.searches;
        own = registration.fit(view_of(p), p.match.pose);
      };
      const Eigen::Vector3d widest = predict(p, motion_time_s(step_s)).sigma;
      const Eigen::Vector3d usual = search_anyway ? usual_sigma(widest, step_s) : widest;
      search(usual);
      if (usual != widest && !registration.acceptable(own, good)) search(widest);
    }
    if (!registration.acceptable(own)) p.match.pose = p.prior.pose;
    if (&p == &set.particles().front() || own.matched_ratio > fit.matched_ratio) fit = own;
  }
  for_each_particle([&](Particle& p, std::uint64_t i) { apply_match(p, step_s, scan.index, i); });
  normalise();
  return fit;
}

void Mapper::Impl::watch_degeneracy(double step_s) {
  if (odometry_delta || slow()) {
    degeneracy.reset();
    return;
  }
  if (!adaptive() && !single()) return;
  const Particle& best = set.best();
  axial.note_speed(std::hypot(best.twist.vx, best.twist.vy), step_s);
  const Pose2 predicted = compose(best.pose, predict(best, step_s).delta);
  const bool was_weak = degeneracy.weak();
  const bool was_active = degeneracy.active();
  const LineSystem system = lines_at(predicted, {}, LinesOf::kNeighbourhood);
  degeneracy.update(system.equations.H, system.associated, step_s);
  if (!degeneracy.weak()) return;
  const WeakMotion weak{degeneracy.axis(), degeneracy.turn_rad_m()};
  degeneracy.hold(lines_at(predicted, weak, LinesOf::kCell).axial_information);
  if (!was_weak) axial.start();
  axial_variance_m2 = axial.predict(step_s, degeneracy.active());
  if (!degeneracy.active() || was_active || !single()) return;
  // Nothing holds the axis from here on: the cart goes on as it went while something did.
  Particle& p = set.particles()[0];
  const AxialMotion::Steady steady = axial.steady(rotation(p.pose.yaw).transpose() * degeneracy.axis());
  p.pose.x += steady.offset_m * degeneracy.axis().x();
  p.pose.y += steady.offset_m * degeneracy.axis().y();
  set_axial_speed(p, steady.speed_m_s);
  axial.go_on(steady);
}

void Mapper::Impl::set_axial_speed(Particle& p, double speed_m_s) const {
  const Eigen::Vector2d a = degeneracy.axis();
  const Eigen::Matrix2d turn = rotation(p.pose.yaw);
  Eigen::Vector2d velocity = turn * Eigen::Vector2d(p.twist.vx, p.twist.vy);
  velocity += a * (speed_m_s - a.dot(velocity));
  velocity = turn.transpose() * velocity;
  p.twist.vx = velocity.x();
  p.twist.vy = velocity.y();
}

void Mapper::Impl::learn_twist_of(Particle& p, const Twist2& before, const Pose2& from, double step_s) const {
  p.twist = learn_twist(before, between(from, p.pose), motion_time_s(step_s), options.motion);
  if (!degeneracy.weak()) return;
  const Eigen::Vector2d a = degeneracy.axis();
  const double limit_m_s = options.motion.max_speed_m_s;
  // The cart keeps its speed, not its share along the axis: scan by scan that loses the cosine of what its direction is
  // off, a per cent in a corridor of 200 m.
  const Eigen::Vector2d velocity(p.twist.vx, p.twist.vy);
  const double along_m_s = a.dot(rotation(p.prior.pose.yaw) * Eigen::Vector2d(before.vx, before.vy));
  const double aside2 = velocity.squaredNorm() - std::pow(a.dot(rotation(p.pose.yaw) * velocity), 2);
  const double speed2 = before.vx * before.vx + before.vy * before.vy;
  const bool goes_along = speed2 > kAlong * aside2;
  const double predicted_m_s = goes_along ? std::copysign(std::sqrt(speed2 - aside2), along_m_s) : along_m_s;
  const double correction_m = a.dot(p.pose.translation() - p.prior.pose.translation());
  set_axial_speed(p, std::clamp(predicted_m_s + axial.speed_gain() * correction_m, -limit_m_s, limit_m_s));
}

void Mapper::Impl::learn_motion(const Scan& scan, const Pose2& before, double step_s, bool fits) {
  const Pose2 delta = between(before, set.best().pose);
  if (fits && single() && slow()) prediction_error.add(between(set.best().prior.pose, set.best().pose));
  const Twist2 last = unwarp_twist();
  if (textbook()) {
    const Twist2 common = learn_twist(last_twist, delta, motion_time_s(step_s), options.motion);
    for (Particle& p : set.particles()) p.twist = common;
  } else if (single()) {
    Particle& p = set.particles()[0];
    const Twist2 twist_before = p.twist;
    learn_twist_of(p, twist_before, before, step_s);
    const bool off = std::hypot(p.twist.vx - last.vx, p.twist.vy - last.vy) > kReunwarp_m_s ||
                     std::abs(p.twist.wz - last.wz) > kReunwarp_rad_s;
    if (off && fits && options.unwarp && scan.geometry.sweep_s > 0.0) {
      registration.unwarp_again(scan, p.twist);
      p.match = registration.match(view_of(p), p.pose, p.prior);
      apply_match(p, step_s, scan.index, 0);
      learn_twist_of(p, twist_before, before, step_s);
    }
    const double information = degeneracy.weak() ? degeneracy.axial_information() : 0.0;
    if (degeneracy.weak()) axial.update(information);
    if (fits && !degeneracy.active()) {
      axial.note(rotation(p.pose.yaw).transpose() * (p.pose.translation() - before.translation()), step_s, information);
    }
  }
  last_twist = set.best().twist;
  if (std::hypot(delta.x, delta.y) > kMoved_m || std::abs(delta.yaw) > kMoved_rad) moved_since_resampling = true;
  if (odometry_delta && options.odometry == OdometryUse::kAuto && fits) gate.judge(*odometry_delta, delta);
}

void Mapper::Impl::note_covariance(double step_s) {
  last_covariance = posterior_covariance();
  const double lost_before_m2 = std::exchange(axial_lost_m2, 0.0);
  if (!degeneracy.active()) return;
  const Eigen::Vector2d a = degeneracy.axis();
  axial_lost_m2 = degeneracy.axial_variance_m2();
  axial_growth += std::max(axial_lost_m2 - lost_before_m2, 0.0) * (a * a.transpose());
  counters.degenerate_s += step_s;
  degenerate_since_keyframe = true;
}

void Mapper::Impl::note_fit(bool fits, double step_s) {
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

void Mapper::Impl::normalise() {
  log_weights.clear();
  for (const Particle& p : set.particles()) log_weights.push_back(p.log_weight);
  weights.resize(log_weights.size());
  n_eff = normalise_weights(log_weights, weights);
  const double top = *std::max_element(log_weights.begin(), log_weights.end());
  for (Particle& p : set.particles()) p.log_weight -= top;
}

void Mapper::Impl::resample_if_needed(std::uint64_t scan_index) {
  if (single() || !moved_since_resampling) return;
  if (!textbook() && n_eff >= 0.5 * static_cast<double>(set.size())) return;
  CounterRandom random(options.seed, scan_index, ~0ULL);
  ancestors.resize(set.size());
  textbook() ? resample_wheel(weights, random, ancestors) : resample_systematic(weights, random, ancestors);
  set.resample(ancestors);
  moved_since_resampling = false;
}

Eigen::Matrix3d Mapper::Impl::posterior_covariance() const {
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

void Mapper::Impl::adapt(const std::optional<CorrelativeResult>& found) {
  if (single()) {
    spread_if_needed(found);
    return;
  }
  // One Gaussian says as much once the particles lie no farther apart than each of them is uncertain.
  const Eigen::Matrix3d& own = set.best().covariance;
  const Eigen::Matrix3d spread = posterior_covariance() - own;
  const double limit_m2 = std::max(options.collapse_m * options.collapse_m, 2.0 * own.topLeftCorner<2, 2>().trace());
  const double limit_rad2 = std::max(options.collapse_rad * options.collapse_rad, 2.0 * own(2, 2));
  if (spread.topLeftCorner<2, 2>().trace() < limit_m2 && spread(2, 2) < limit_rad2) set.coalesce();
}

void Mapper::Impl::spread_if_needed(const std::optional<CorrelativeResult>& found) {
  // Not along an axis that nothing holds: what says which particle is right there speaks for the one that lags, whose
  // points still lie on the map.
  const std::optional<Pose2> other_place =
      found ? registration.second_place(view_of(set.best()), set.best(), *found) : std::nullopt;
  if (!other_place) return;
  set.spread(std::min(kPlaces, options.max_adaptive_particles), window.front().map().layer());
  for (std::size_t i = 1; i < set.size(); ++i) {
    Particle& p = set.particles()[i];
    if (i % 2 == 1) p.pose = *other_place;
    p.mode = p.pose;
  }
  normalise();
}

}  // namespace submapd
