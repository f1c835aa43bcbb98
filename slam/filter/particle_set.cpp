#include "slam/filter/particle_set.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace submapd {

ParticleSet::ParticleSet(const ParticleSetOptions& options, DistanceLayers& layers, double cell_m, Baker baker)
    : options_(options),
      layers_(layers),
      cells_per_m_(1.0 / cell_m),
      baker_(std::move(baker)),
      tree_(options.max_nodes),
      scans_(static_cast<std::size_t>(options.max_scans)) {
  const auto n = static_cast<std::size_t>(options.max_particles);
  particles_.reserve(n);
  scratch_.reserve(n);
  copies_.reserve(n);
  oldest_.reserve(n);
  heirs_.reserve(n);
  free_scans_.reserve(scans_.size());
  for (KeyframeScan& scan : scans_) {
    scan.beams.reserve(static_cast<std::size_t>(options.max_beams));
    scan.scan.ranges_mm.reserve(static_cast<std::size_t>(options.max_beams));
  }
  reset({}, {});
}

void ParticleSet::reset(const Pose2& pose, const Twist2& twist) {
  for (const Particle& p : particles_) {
    if (p.layer >= 0) layers_.release(p.layer);
  }
  free_scans_.clear();
  for (int i = static_cast<int>(scans_.size()) - 1; i >= 0; --i) {
    scans_[static_cast<std::size_t>(i)].references = 0;
    free_scans_.push_back(i);
  }
  tree_.reset(pose, 1);
  particles_.resize(1);
  particles_[0] = Particle{};
  particles_[0].pose = pose;
  particles_[0].mode = pose;
  particles_[0].twist = twist;
  particles_[0].node = tree_.root();
}

const Particle& ParticleSet::best() const {
  return *std::max_element(particles_.begin(), particles_.end(),
                           [](const Particle& a, const Particle& b) { return a.log_weight < b.log_weight; });
}

void ParticleSet::spread(int n, int base_layer) {
  const Particle seed = particles_[0];
  const int wanted = std::min(n, options_.max_particles);
  if (wanted < 2) return;
  particles_[0].layer = layers_.duplicate(base_layer);
  if (particles_[0].layer < 0) return;
  for (int i = 1; i < wanted; ++i) {
    Particle copy = seed;
    copy.layer = layers_.duplicate(base_layer);
    if (copy.layer < 0) break;
    tree_.add_head(copy.node);
    particles_.push_back(copy);
  }
  if (particles_.size() == 1) {
    layers_.release(particles_[0].layer);
    particles_[0].layer = -1;
  }
  for (Particle& p : particles_) p.log_weight = 0.0;
}

void ParticleSet::resample(std::span<const int> ancestors) {
  copies_.assign(particles_.size(), 0);
  for (const int a : ancestors) ++copies_[static_cast<std::size_t>(a)];
  for (std::size_t i = 0; i < particles_.size(); ++i) {
    if (copies_[i] != 0) continue;
    tree_.remove_head(particles_[i].node);
    if (particles_[i].layer >= 0) layers_.release(particles_[i].layer);
  }
  scratch_.clear();
  for (std::size_t i = 0; i < particles_.size(); ++i) {
    for (int k = 0; k < copies_[i]; ++k) {
      Particle copy = particles_[i];
      copy.log_weight = 0.0;
      if (k > 0) {
        tree_.add_head(copy.node);
        copy.layer = layers_.duplicate(particles_[i].layer);
      }
      scratch_.push_back(copy);
    }
  }
  particles_.swap(scratch_);
  recycle_slots();
}

void ParticleSet::coalesce() {
  if (particles_.size() > 1) {
    const Particle kept = best();
    for (const Particle& p : particles_) {
      if (p.layer == kept.layer) continue;
      tree_.remove_head(p.node);
      layers_.release(p.layer);
    }
    layers_.release(kept.layer);
    particles_.resize(1);
    particles_[0] = kept;
    particles_[0].layer = -1;
    particles_[0].log_weight = 0.0;
  }
  bake_agreed();
}

void ParticleSet::recycle_slots() {
  for (const int slot : tree_.freed_slots()) {
    KeyframeScan& scan = scans_[static_cast<std::size_t>(slot)];
    if (--scan.references == 0) free_scans_.push_back(slot);
  }
  tree_.freed_slots().clear();
}

void ParticleSet::bake_agreed() {
  while (const std::optional<int> root = tree_.advance_root()) {
    const AncestryTree::Node& node = tree_.node(*root);
    baker_(node.pose, scans_[static_cast<std::size_t>(node.scan_slot)]);
    tree_.drop_root_scan();
  }
  recycle_slots();
}

void ParticleSet::for_each_pending(const Baker& visit) const {
  std::vector<int> lineage;
  for (int node = best().node; node >= 0 && tree_.node(node).scan_slot >= 0; node = tree_.node(node).parent) {
    lineage.push_back(node);
  }
  for (auto node = lineage.rbegin(); node != lineage.rend(); ++node) {
    const AncestryTree::Node& n = tree_.node(*node);
    visit(n.pose, scans_[static_cast<std::size_t>(n.scan_slot)]);
  }
}

int ParticleSet::oldest_of(const Particle& p) const {
  int node = p.node;
  while (tree_.node(node).parent != tree_.root() && node != tree_.root()) node = tree_.node(node).parent;
  return node;
}

// Which version of the oldest open key-frame has the most weight? Its particles take the places of all others.
void ParticleSet::agree_on_oldest() {
  const double top = best().log_weight;
  oldest_.clear();
  for (const Particle& p : particles_) oldest_.push_back(oldest_of(p));
  const auto weight_of = [&](std::size_t i) { return std::exp(particles_[i].log_weight - top); };
  double heaviest = 0.0;
  int winner = oldest_[0];
  for (const int candidate : oldest_) {
    double weight = 0.0;
    for (std::size_t i = 0; i < particles_.size(); ++i) weight += oldest_[i] == candidate ? weight_of(i) : 0.0;
    if (weight <= heaviest) continue;
    heaviest = weight;
    winner = candidate;
  }
  // Systematic resampling among the winners.
  heirs_.clear();
  double passed = 0.0;
  int last = 0;
  for (std::size_t i = 0; i < particles_.size(); ++i) {
    if (oldest_[i] != winner) continue;
    last = static_cast<int>(i);
    passed += weight_of(i) / heaviest;
    while (static_cast<double>(heirs_.size()) + 0.5 < passed * static_cast<double>(particles_.size())) {
      heirs_.push_back(last);
    }
  }
  while (heirs_.size() < particles_.size()) heirs_.push_back(last);
  resample(heirs_);
  bake_agreed();
}

int ParticleSet::take_scan_slot() {
  if (free_scans_.empty()) {
    ++forced_;
    agree_on_oldest();
  }
  if (tree_.live_nodes() + static_cast<int>(particles_.size()) > tree_.max_nodes()) {
    ++forced_;
    coalesce();
  }
  const int slot = free_scans_.back();
  free_scans_.pop_back();
  return slot;
}

bool ParticleSet::stamp(int layer, const Pose2& pose, const KeyframeScan& scan) {
  const double c = std::cos(pose.yaw);
  const double s = std::sin(pose.yaw);
  bool complete = true;
  for (const BeamEnd& b : scan.beams) {
    if (!b.hit || b.range_m <= 0.0F) continue;
    const auto x = static_cast<double>(b.x);
    const auto y = static_cast<double>(b.y);
    const CellIndex cell = cell_at(pose.x + c * x - s * y, pose.y + s * x + c * y, cells_per_m_);
    if (in_map(cell) && layers_.view(layer).at(cell) != 0) complete = layers_.stamp(layer, cell) && complete;
  }
  return complete;
}

void ParticleSet::insert_keyframe(const Scan& scan, const Twist2& twist, std::span<const BeamEnd> beams,
                                  const Eigen::Vector2f& origin, const Eigen::Matrix3d& step_covariance,
                                  bool degenerate) {
  const int slot = take_scan_slot();
  KeyframeScan& kept = scans_[static_cast<std::size_t>(slot)];
  kept.scan.stamp_us = scan.stamp_us;
  kept.scan.index = scan.index;
  kept.scan.geometry = scan.geometry;
  kept.scan.ranges_mm.assign(scan.ranges_mm.begin(), scan.ranges_mm.end());
  kept.twist = twist;
  kept.beams.assign(beams.begin(), beams.end());
  kept.origin = origin;
  kept.step_covariance = step_covariance;
  kept.degenerate = degenerate;
  kept.references = static_cast<int>(particles_.size());
  bool complete = true;
  for (Particle& p : particles_) {
    p.node = tree_.extend(p.node, p.pose, slot);
    if (p.layer >= 0) complete = stamp(p.layer, p.pose, kept) && complete;
  }
  peak_bytes_ = std::max(peak_bytes_, bytes_used());
  bake_agreed();
  if (!complete) {
    ++forced_;
    coalesce();
  }
}

void ParticleSet::change_frame(const Pose2& change) {
  tree_.change_frame(change);
  for (Particle& p : particles_) {
    p.pose = compose(change, p.pose);
    p.mode = compose(change, p.mode);
  }
}

std::size_t ParticleSet::bytes_used() const {
  const std::size_t per_scan =
      sizeof(KeyframeScan) + static_cast<std::size_t>(options_.max_beams) * (sizeof(BeamEnd) + sizeof(std::uint16_t));
  return static_cast<std::size_t>(tree_.live_nodes()) * sizeof(AncestryTree::Node) +
         (scans_.size() - free_scans_.size()) * per_scan + particles_.size() * sizeof(Particle);
}

std::size_t ParticleSet::bytes_limit() const {
  const std::size_t per_scan =
      sizeof(KeyframeScan) + static_cast<std::size_t>(options_.max_beams) * (sizeof(BeamEnd) + sizeof(std::uint16_t));
  return static_cast<std::size_t>(options_.max_nodes) * sizeof(AncestryTree::Node) + scans_.size() * per_scan +
         2 * static_cast<std::size_t>(options_.max_particles) * sizeof(Particle);
}

}  // namespace submapd
