#include "slam/filter/mapper.hpp"

#include <algorithm>

#include "slam/filter/internal/mapper_impl.hpp"

namespace submapd {
namespace {

ParticleSetOptions particle_options(const MapperOptions& o) {
  ParticleSetOptions p;
  p.max_particles = std::max(o.particles, o.max_adaptive_particles);
  p.max_scans = o.limits.pending_keyframes;
  p.max_beams = o.max_beams;
  return p;
}

}  // namespace

Mapper::Impl::Impl(const MapperOptions& o, const Uuid& cart_id, const Uuid& run_id, WorkerPool& workers)
    : options(o),
      cart(cart_id),
      run(run_id),
      pool(workers),
      layers(o.distance_planes, std::max(o.particles, o.max_adaptive_particles) + 4),
      window(o.map, o.limits, layers, o.max_beams),
      registration(options),
      degeneracy(o.degeneracy),
      axial(o.axial),
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

Mapper::Mapper(const MapperOptions& options, const Uuid& cart, const Uuid& run, WorkerPool& pool)
    : impl_(std::make_unique<Impl>(options, cart, run, pool)) {}
Mapper::~Mapper() = default;

ScanReport Mapper::process(const Scan& scan) {
  Impl& m = *impl_;
  ++m.counters.scans;
  const double elapsed_s = static_cast<double>(scan.stamp_us - m.last_stamp_us) * 1e-6;
  m.last_stamp_us = scan.stamp_us;
  if (m.window.is_open()) m.period.add(elapsed_s);
  ScanReport report;
  report.scan_index = scan.index;
  report.stamp_us = scan.stamp_us;
  const std::optional<Pose2> by_odometry = m.gate.motion(scan.odometry);
  m.odometry_delta = m.options.odometry == OdometryUse::kIgnore ? std::nullopt : by_odometry;
  KnownFit fit;
  const std::optional<double> gap_s = m.gap_before(scan);
  if (gap_s) {
    m.pick_up(scan, *gap_s, report, fit);
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

void Mapper::stood_until(std::int64_t stamp_us) {
  impl_->tracked_us = impl_->seen_us = stamp_us;
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
