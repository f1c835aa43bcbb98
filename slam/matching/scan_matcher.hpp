// One scan against one map: both stages, and the health of the result.
#pragma once

#include "slam/grid/index_map.hpp"
#include "slam/matching/field_matcher.hpp"
#include "slam/matching/line_matcher.hpp"

namespace submapd {

struct ScanMatcherOptions {
  FieldMatcherOptions field;
  LineMatcherOptions lines;
  bool use_lines = true;           // [experiment]: stage 2 off
  double min_line_ratio = 0.4;     // fewer points on surfaces: stage 1 stands
  double max_line_shift_m = 0.15;  // stage 2 refines; a jump is a wrong association
  double max_line_shift_rad = 0.035;
};

// Matches from `start`. `field` is the particle's own distance layer, `map` the shared base with the surfaces.
// Thread-safe while nobody inserts.
[[nodiscard]] MatchResult match_scan(const ScanPoints& points, const DistanceView& field, const IndexMap& map,
                                     const Pose2& start, const MotionPrior& prior, const ScanMatcherOptions& options);

// Fills matched_ratio and contradiction for a pose, counting only points that fall on known cells: matched_ratio is 1
// and `known_ratio` small where the scan looks into new territory.
struct KnownFit {
  double known_ratio = 0.0;    // share of points on known cells or near obstacles
  double matched_ratio = 1.0;  // of those, near an obstacle
  double contradiction = 0.0;  // of those, more than two cells inside known free space
};
[[nodiscard]] KnownFit known_fit(const ScanPoints& points, const DistanceView& field, const IndexMap& map,
                                 const Pose2& pose);

}  // namespace submapd
