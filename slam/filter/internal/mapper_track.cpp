#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/small_matrix.hpp"
#include "slam/filter/internal/mapper_impl.hpp"
#include "slam/filter/internal/relocalisation.hpp"

namespace submapd {
namespace {

constexpr double kLostBreak_s = 0.6;  // this long without a match: the map goes on in a new sub-map
constexpr int kLostBreakScans = 5;
constexpr double kShortest_s = 0.005;
constexpr double kUnseen_s = 0.6;   // without a scan that sees anything: the cart may have stopped or turned since
constexpr double kAnyTime_s = 1e6;  // nobody knows how far it was carried
constexpr int kComparedPoints = 30;
constexpr double kSamePlace = 0.5;    // share of a scan that the one before it showed, at least
constexpr double kOpenedView = 0.1;   // share that lies behind what was seen: more than a passer-by who left
constexpr double kSurelyKnown = 0.5;  // such a scan belongs to the map only if it fits very well
constexpr double kSurelyMatched = 0.7;
// A scan from elsewhere errs less like the one before it than a scan from the same place does.
constexpr double kSlowEvidence = 5.0;
constexpr double kUsualShare = 0.05;  // of the newest scan

double entropy_of(const Eigen::Matrix3d& covariance) {
  const double det = std::max(covariance.determinant(), 1e-30);
  return 0.5 * (3.0 * std::log(2.0 * std::numbers::pi * std::numbers::e) + std::log(det));
}

}  // namespace

void Mapper::Impl::start_in_front(const Scan& scan) {
  set.reset({}, {});
  degeneracy.reset();
  axial.reset();
  last_covariance.setZero();
  axial_growth.setZero();
  last_keyframe_covariance.setZero();
  lost_scans = 0;
  lost_time_s = 0.0;
  registration.assign(scan, {});
  note_seen(scan);
  insert_keyframe(scan);
  refill();
}

void Mapper::Impl::break_track(const Scan& scan) {
  set.coalesce();
  const Pose2 odom = compose(window.front().odom_from_submap(), set.best().pose);
  window.close(FinishReason::kDivergence);
  window.open_front(odom, false);
  start_in_front(scan);
  ++counters.breaks;
}

void Mapper::Impl::hand_over(FinishReason reason) {
  set.coalesce();
  const Pose2 back_from_front = window.hand_over(reason);
  set.change_frame(back_from_front);
  degeneracy.change_frame(back_from_front.yaw);
  last_covariance = turned(last_covariance, back_from_front.yaw);
  const Eigen::Matrix2d turn = rotation(back_from_front.yaw);
  axial_growth = turn * axial_growth * turn.transpose();
  last_keyframe_covariance = turned(last_keyframe_covariance, back_from_front.yaw);
}

void Mapper::Impl::hand_over_if_full() {
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

void Mapper::Impl::insert_keyframe(const Scan& scan) {
  const Pose2 before = set.tree().node(set.best().node).pose;
  // Both ends were matched to the same map: the step is as uncertain as the two matches.
  Eigen::Matrix3d step = last_keyframe_covariance + last_covariance;
  step.topLeftCorner<2, 2>() += axial_growth;
  step = turned(step, -before.yaw);
  last_keyframe_covariance = last_covariance;
  axial_growth.setZero();
  set.insert_keyframe(scan, unwarp_twist(), registration.points().beams(), registration.points().origin(), step,
                      degenerate_since_keyframe);
  degenerate_since_keyframe = degeneracy.active();
  last_keyframe_index = scan.index;
  last_keyframe_stamp_us = scan.stamp_us;
}

bool Mapper::Impl::wants_keyframe(const Scan& scan) const {
  const Pose2 step = since_keyframe();
  const double distance = std::hypot(step.x, step.y);
  if (distance > options.keyframe_m || std::abs(step.yaw) > options.keyframe_rad) return true;
  const double waited_s = static_cast<double>(scan.stamp_us - last_keyframe_stamp_us) * 1e-6;
  return waited_s > options.keyframe_s &&
         (distance > 0.1 * options.keyframe_m || std::abs(step.yaw) > 0.2 * options.keyframe_rad);
}

void Mapper::Impl::add_keyframe(const Scan& scan, ScanReport& report) {
  if (window.room() <= set.pending_keyframes()) {  // nobody took the last finished sub-map yet, or it is never full
    ++counters.keyframes_refused;
    return;
  }
  report.keyframe_step = since_keyframe();
  report.keyframe_linked = true;
  report.keyframe = true;
  insert_keyframe(scan);
}

bool Mapper::Impl::doubtful(const KnownFit& fit) {
  if (usual_fit == 0.0) usual_fit = fit.matched_ratio;
  const bool worse = fit.matched_ratio < usual_fit - kMuchWorse;
  usual_fit += kUsualShare * (fit.matched_ratio - usual_fit);
  return worse && slow();
}

void Mapper::Impl::insert_again(const FinishedSubmap& submap) {
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

void Mapper::Impl::resume_after(const FinishedSubmap& last) {
  window.count_from(last.id.index);
  window.open_front(last.odom_from_submap, last.linked_to_previous);
  insert_again(last);
  const Keyframe& newest = last.keyframes.back();
  last_stamp_us = tracked_us = seen_us = newest.stamp_us;
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

std::optional<double> Mapper::Impl::gap_before(const Scan& scan) const {
  if (!window.is_open()) return std::nullopt;
  const auto since = [&scan](std::int64_t stamp_us) { return static_cast<double>(scan.stamp_us - stamp_us) * 1e-6; };
  if (gap) {
    const double gap_s = since(tracked_us);
    return gap_s > options.motion.max_extrapolation_s ? std::optional(gap_s) : std::nullopt;
  }
  const bool followed_otherwise = textbook() || odometry_delta || slow();
  const double gap_s = since(seen_us);
  return !followed_otherwise && gap_s > kUnseen_s ? std::optional(gap_s) : std::nullopt;
}

void Mapper::Impl::note_seen(const Scan& scan) {
  continuity.keep(registration.points());
  seen_us = scan.stamp_us;
}

bool Mapper::Impl::shows_another_place(double step_s) const {
  if (textbook() || odometry_delta || step_s > options.low_rate_s || registration.blind()) return false;
  const Particle& best = set.best();
  const ScanContinuity::Change change = continuity.compare(registration.points(), predict(best, step_s).delta);
  return change.compared >= kComparedPoints && change.same < kSamePlace && change.farther > kOpenedView;
}

void Mapper::Impl::pick_up(const Scan& scan, double gap_s, ScanReport& report, KnownFit& fit) {
  registration.assign(scan, {});
  if (registration.blind() || !window.may_close()) {  // a place may not be found, and then the front is closed
    report.lost = true;
    ++counters.lost_scans;
    return;
  }
  set.coalesce();
  degeneracy.reset();
  axial.reset();
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
  note_seen(scan);
  p.covariance = last_covariance = covariance_of(found->information, options.covariance_kappa, Eigen::Matrix3d::Zero());
  fit = registration.fit(view, p.pose);
  lost_scans = 0;
  lost_time_s = 0.0;
  add_keyframe(scan, report);
  refill();
}

void Mapper::Impl::track(const Scan& scan, double elapsed_s, ScanReport& report, KnownFit& fit) {
  const double step_s = period.bursting() ? std::max(elapsed_s, period.usual_s()) : std::max(elapsed_s, kShortest_s);
  registration.assign(scan, unwarp_twist());
  // A slow log's few hits make no line of a cell alone.
  registration.set_lines(slow() ? LinesOf::kNeighbourhood : LinesOf::kCell);
  registration.set_evidence(slow() && !odometry_delta ? kSlowEvidence : 1.0);
  const Pose2 before = set.best().pose;
  const bool elsewhere = shows_another_place(step_s);
  std::optional<CorrelativeResult> found;
  fit = textbook() ? filter_by_sampling(scan, step_s) : filter_by_matching(scan, step_s, found);
  // The textbook's filter trusts its motion model: it neither loses its track nor starts anew.
  const bool fits = textbook() ? !registration.blind() : registration.acceptable(fit);
  learn_motion(scan, before, step_s, fits);
  note_covariance(step_s);
  note_fit(fits, step_s);
  resample_if_needed(scan.index);
  if (adaptive()) adapt(found);

  report.lost = !fits;
  if (!registration.blind()) note_seen(scan);
  const bool given_up = lost_scans >= kLostBreakScans && lost_time_s > kLostBreak_s;
  const bool carried_off = elsewhere && (fit.known_ratio < kSurelyKnown || fit.matched_ratio < kSurelyMatched);
  if ((given_up || carried_off) && !registration.blind() && window.may_close()) {
    report.lost = false;
    pick_up(scan, kAnyTime_s, report, fit);
  } else if (fits && !doubtful(fit) && wants_keyframe(scan)) {
    add_keyframe(scan, report);
  }
}

void Mapper::Impl::fill_report(ScanReport& report, const KnownFit& fit) const {
  const Particle& best = set.best();
  report.submap = window.front().index();
  report.submap_from_base = best.pose;
  report.odom_from_base = compose(window.front().odom_from_submap(), best.pose);
  report.keyframe_scan_index = last_keyframe_index;
  report.keyframe_from_base = since_keyframe();
  report.covariance = last_covariance;
  if (degeneracy.active()) {
    const Eigen::Vector2d a = degeneracy.axis();
    report.covariance.topLeftCorner<2, 2>() += degeneracy.axial_variance_m2() * (a * a.transpose());
  }
  report.entropy = entropy_of(report.covariance);
  report.particles = static_cast<int>(set.size());
  report.n_eff = single() ? 1.0 : n_eff;
  report.degenerate = degeneracy.active();
  report.odometry_used = odometry_delta.has_value();
  report.health = best.match.health;
  report.health.matched_ratio = fit.matched_ratio;
  report.health.contradiction = fit.contradiction;
}

}  // namespace submapd
