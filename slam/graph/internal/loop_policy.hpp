// When a loop may bend the map (design notes 11.4). Tuned for precision: a wrong loop costs the session, a late one
// nothing.
//
// A pending loop is confirmed when it agrees
//  (i)   with another loop at least 5 m away, or with one of the next sub-map: as a clique of pending loops, or through
//        the graph's prediction where that rests on loops confirmed before;
//  (ii)  at the end of a run only (`accept_lone`): with the prediction of the chain alone, if that is tight and the
//  match is
//        strong.
// Without GraphParts::pairwise_consistency whatever the prediction does not contradict is confirmed.
// An agreement counts only as far as it was unlikely to come about by chance, see Consistency.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "slam/base/status.hpp"
#include "slam/graph/internal/graph_model.hpp"

namespace submapd::graph {

// Confirms what may be confirmed now and returns the indices of those loops. Call again after the next solve: what has
// been confirmed sharpens the predictions.
std::vector<std::size_t> confirm_loops(GraphModel& model, bool accept_lone);

// Cauchy weight of the median landmark of a loop at the present poses, 0..1: 1/(1 + χ²) of the distance between the two
// places it should be at.
[[nodiscard]] double loop_weight(const GraphModel& model, const LoopRecord& record);

// Confirmed loops that weigh less than 0.25 go back to pending; returns how many.
int demote_loops(GraphModel& model);

// Confirms, solves and demotes until nothing more follows. `solved`: the poses are those of the graph as it is, it need
// not be solved if nothing is confirmed. `solve` gets the loops confirmed since the last time; its first error ends it.
Status settle_loops(GraphModel& model, bool accept_lone, bool solved,
                    const std::function<Status(const std::vector<std::size_t>& news)>& solve);

// At the end: pending loops that plainly contradict the finished graph are rejected and lose their landmarks.
int reject_contradicted(GraphModel& model);

}  // namespace submapd::graph
