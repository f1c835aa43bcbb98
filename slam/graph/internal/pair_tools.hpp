// What the optimizer asks about pairs of sub-maps: outlines, matching, landmarks. The real ones, or a double in tests.
#pragma once

#include <functional>
#include <vector>

#include "slam/landmark/landmark.hpp"
#include "slam/loop/submap_match.hpp"
#include "slam/loop/submap_matcher.hpp"
#include "slam/loop/submap_outline.hpp"
#include "slam/loop/submap_view.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// All deterministic, called from the optimizer's thread; see the functions of the same names for their contracts.
struct PairTools {
  std::function<SubmapOutline(const FinishedSubmap&)> make_outline;
  std::function<double(const SubmapOutline& a, const SubmapOutline& b, const Pose2& a_from_b, double grow_m)>
      overlap_m2;
  std::function<SubmapMatch(const SubmapView& a, const SubmapView& b, const MatchPrior& prior)> search;
  std::function<SubmapMatch(const SubmapView& a, const SubmapView& b, const Pose2& start)> refine;
  std::function<std::vector<VirtualLandmark>(const SubmapView& a, const SubmapView& b, const SubmapMatch&)>
      choose_landmarks;
};

// slam/loop and slam/landmark, the latter with its default options.
[[nodiscard]] PairTools default_pair_tools(const SubmapMatcherOptions& options);

}  // namespace submapd
