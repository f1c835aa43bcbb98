// One scan against the map: the descent from the prediction, the wide search where the descent does not fit, and what
// makes a pose acceptable (design notes 5).
//
// Holds the scan's points. match(), fit() and the likelihoods are const and may run on several threads at once;
// assign() and search_about() belong to one.
#pragma once

#include <optional>

#include "slam/filter/mapper.hpp"

namespace submapd {

// What a particle matches against: the base map and the particle's own distance field.
struct MapView {
  const IndexMap& map;
  DistanceView field;
};

class ScanRegistration {
 public:
  explicit ScanRegistration(const MapperOptions& options);

  void assign(const Scan& scan, const Twist2& twist) { points_.assign(scan, twist); }
  void unwarp_again(const Scan& scan, const Twist2& twist) { points_.unwarp_again(scan, twist); }
  [[nodiscard]] const ScanPoints& points() const { return points_; }
  // What scans are aligned to from here on.
  void set_lines(LinesOf lines) { matcher_.lines.lines = lines; }
  // How much more than in a run of a fast scanner each scan tells of the place, from now on.
  void set_evidence(double times) { evidence_ = times; }

  // Too few points: the sensor sees nothing, which is no new territory.
  [[nodiscard]] bool blind() const;
  // The pose fits the map, or hardly any of the scan lies on known ground and there is nothing to contradict.
  // `good`: share of what lies on known ground that must fit, if more than always.
  [[nodiscard]] bool acceptable(const KnownFit& fit, double good = 0.0) const;

  [[nodiscard]] MatchResult match(const MapView& view, const Pose2& start, const MotionPrior& prior) const;
  [[nodiscard]] KnownFit fit(const MapView& view, const Pose2& pose) const;
  [[nodiscard]] double log_likelihood(const MapView& view, const Pose2& pose) const;
  // Log of what the map and the motion model together say about a pose, up to a constant.
  [[nodiscard]] double log_posterior(const MapView& view, const Pose2& pose, const MotionPrior& prior) const;

  // Wide search about the particle's prior, then both stages again; what was matched before stays if it is the likelier
  // place. `sigma` is the motion model's; `widen` >= 1 after scans that were lost. A place where less than `good` of
  // the scan matches gives way to one where more does, however odd the motion.
  CorrelativeResult search_about(const MapView& view, Particle& p, const Eigen::Vector3d& sigma, double widen,
                                 double good);

  // The search's second peak, if it is a place of its own and nearly as likely as the first: descending from it must
  // not lead to the same pose, and the motion model must allow it.
  [[nodiscard]] std::optional<Pose2> second_place(const MapView& view, const Particle& p,
                                                  const CorrelativeResult& found) const;

 private:
  const MapperOptions& options_;  // the mapper's
  ScanPoints points_;
  CorrelativeSearch search_;
  LikelihoodTable likelihood_;
  ScanMatcherOptions matcher_;
  double evidence_ = 1.0;
};

}  // namespace submapd
