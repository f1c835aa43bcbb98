// A person's ties as the graph takes them, and what is worth a person's look (design notes, section 12).
#pragma once

#include <vector>

#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/loop_search.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd::graph {

// A confirmed loop whose match is what the points say, each spot seen from the key-frames of both sub-maps that are
// nearest to it. REQUIRES: both sub-maps are retained, the points are usable (relative_pose_of()).
[[nodiscard]] LoopRecord tie_record(const GraphModel& model, const ManualTie& tie);

// Links and confirmed loops between retained sub-maps at `poses`, one for each sub-map.
[[nodiscard]] std::vector<TieStress> stress_of(const GraphModel& model, const std::vector<SubmapPose>& poses);

// Largest effect first. Barred pairs are nobody's business.
[[nodiscard]] std::vector<SuspectPair> suspects_of(const GraphModel& model, const PairTools& tools,
                                                   const LoopSearch& search, const std::vector<TieStress>& ties);

}  // namespace submapd::graph
