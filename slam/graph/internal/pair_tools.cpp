#include "slam/graph/internal/pair_tools.hpp"

#include "slam/graph/optimizer.hpp"
#include "slam/landmark/landmark_selection.hpp"

namespace submapd {

PairTools default_pair_tools(const SubmapMatcherOptions& options) {
  const SubmapMatcher matcher{options};
  PairTools tools;
  tools.make_outline = [](const FinishedSubmap& submap) { return make_outline(submap); };
  tools.overlap_m2 = [](const SubmapOutline& a, const SubmapOutline& b, const Pose2& a_from_b, double grow_m) {
    return overlap_m2(a, b, a_from_b, grow_m);
  };
  tools.search = [matcher](const SubmapView& a, const SubmapView& b, const MatchPrior& prior) {
    return matcher.search(a, b, prior);
  };
  tools.refine = [matcher](const SubmapView& a, const SubmapView& b, const Pose2& start) {
    return matcher.refine(a, b, start);
  };
  tools.choose_landmarks = [](const SubmapView& a, const SubmapView& b, const SubmapMatch& match) {
    return choose_landmarks(a, b, match, LandmarkOptions{});
  };
  return tools;
}

// Here and not in optimizer.cpp, so that tests with tools of their own do not link the matcher.
Optimizer::Optimizer(const OptimizerOptions& options, SubmapSource& source)
    : Optimizer(options, source, default_pair_tools({.contradiction_test = options.parts.contradiction_test})) {}

}  // namespace submapd
