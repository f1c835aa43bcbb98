#include "slam/graph/optimizer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <optional>
#include <utility>

#include "slam/graph/internal/condensation.hpp"
#include "slam/graph/internal/final_graph.hpp"
#include "slam/graph/internal/graph_model.hpp"
#include "slam/graph/internal/live_graph.hpp"
#include "slam/graph/internal/loop_policy.hpp"
#include "slam/graph/internal/loop_search.hpp"
#include "slam/graph/internal/manual_ties.hpp"
#include "slam/graph/internal/pair_tools.hpp"
#include "slam/graph/internal/relative_uncertainty.hpp"
#include "slam/submap/with_open_submap.hpp"

namespace submapd {
namespace {

using graph::GraphModel;
using graph::LoopCandidate;
using graph::LoopRecord;

// The budget of loop work, in matcher runs (notes 10): a few while the cart rolls, the rest when it is done.
constexpr std::size_t kLiveRuns = 3;
constexpr std::size_t kFinalRunsPerSubmap = 6;
constexpr std::size_t kSaveRuns = 40;  // of a map that is saved meanwhile: somebody waits for it
constexpr std::uint32_t kLiveGap = 3;  // nearer ones overlap by construction and teach little
constexpr std::uint32_t kFinalGap = 2;
// The graph is condensed before it is full, because sub-maps that are new have more to add, and then by several at
// once.
constexpr std::size_t kFullPart = 16;  // of the budget that is left free at least
constexpr std::size_t kRoomPart = 8;   // of it that is made free

bool finite(const Pose2& pose) {
  return std::isfinite(pose.x) && std::isfinite(pose.y) && std::isfinite(pose.yaw);
}

Status check(const FinishedSubmap* submap, std::size_t expected_index) {
  if (submap == nullptr) return {StatusCode::kInvalidArgument, "optimizer: no sub-map given"};
  const std::string name = fmt::format("optimizer: sub-map {}", submap->id.index);
  if (submap->id.index != expected_index) {
    return {StatusCode::kInvalidArgument,
            fmt::format("{} came where {} was due; hand them over in order", name, expected_index)};
  }
  if (submap->keyframes.empty()) return {StatusCode::kInvalidArgument, name + " has no key-frames"};
  if (!finite(submap->odom_from_submap)) return {StatusCode::kInvalidArgument, name + " has no finite pose"};
  for (std::size_t k = 0; k < submap->keyframes.size(); ++k) {
    const Keyframe& keyframe = submap->keyframes[k];
    if (!finite(keyframe.pose) || (k > 0 && keyframe.scan_index <= submap->keyframes[k - 1].scan_index)) {
      return {StatusCode::kInvalidArgument,
              fmt::format("{}: key-frame {} is not finite or not in order of its scan", name, k)};
    }
  }
  return {};
}

}  // namespace

struct Optimizer::Impl {
  Impl(const OptimizerOptions& options_in, SubmapSource& source, PairTools tools_in)
      : options(options_in), tools(std::move(tools_in)), archive(source), search(tools, source) {
    for (const auto& [a, b] : options.edits.barred) search.bar(a, b);
    model.parts = options.parts;
  }
  // A copy that goes on by itself, with another source.
  Impl(const Impl& other, SubmapSource& source)
      : options(other.options),
        tools(other.tools),
        archive(source),
        search(other.search, tools, source),
        model(other.model),
        counters(other.counters),
        version(other.version),
        rejected_pending(other.rejected_pending),
        condensed_loops(other.condensed_loops),
        settled(other.settled),
        cancelled(other.cancelled) {}

  Expected<FinalResult> finish(std::size_t runs);
  Status take(const std::shared_ptr<const FinishedSubmap>& newest);
  std::vector<std::size_t> add_manual_ties();
  void seek_live();
  void seek_all(std::size_t budget, bool accept_lone);
  Status settle(bool accept_lone);
  Status solve(const std::vector<std::size_t>& news);
  void hold_budget();
  [[nodiscard]] std::size_t retained() const;
  [[nodiscard]] std::size_t bytes_left() const;
  void count();
  [[nodiscard]] std::vector<Loop> loops() const;

  OptimizerOptions options;
  PairTools tools;
  SubmapSource& archive;
  graph::LoopSearch search;
  GraphModel model;
  OptimizerCounters counters;
  std::uint32_t version = 0;
  std::uint64_t rejected_pending = 0;
  std::uint64_t condensed_loops = 0;  // that had been confirmed
  bool settled = false;               // nothing came to the graph since it was solved
  std::shared_ptr<std::atomic<bool>> cancelled = std::make_shared<std::atomic<bool>>(false);  // of all copies
};

std::size_t Optimizer::Impl::bytes_left() const {
  return options.graph_bytes_limit - std::min(options.graph_bytes_limit, counters.bytes_used);
}

void Optimizer::Impl::count() {
  counters.submaps = model.submaps.size();
  counters.landmarks = counters.loops_pending = 0;
  counters.loops_confirmed = condensed_loops;
  std::size_t bytes = search.bytes() + model.edges.capacity() * sizeof(graph::CondensedEdge);
  for (const auto& record : model.submaps) bytes += graph::bytes_of(record);
  for (const auto& link : model.links) {
    counters.landmarks += link.landmarks.size();
    bytes += graph::bytes_of(link.landmarks);
  }
  for (const LoopRecord& record : model.loops) {
    bytes += sizeof(record) + graph::bytes_of(record.landmarks);
    if (record.loop.state == LoopState::kConfirmed) {
      ++counters.loops_confirmed;
      counters.landmarks += record.landmarks.size();
    } else if (record.loop.state == LoopState::kPending) {
      ++counters.loops_pending;
    }
  }
  counters.loop_candidates = search.runs();
  counters.loops_rejected = search.refused() + rejected_pending;
  counters.refused_for_memory = search.refused_for_memory();
  counters.bytes_used = bytes;
  counters.bytes_peak = std::max(counters.bytes_peak, bytes);
}

std::size_t Optimizer::Impl::retained() const {
  return model.submaps.size() - static_cast<std::size_t>(counters.submaps_condensed + counters.submaps_frozen);
}

void Optimizer::Impl::hold_budget() {
  const auto free_below = [this](std::size_t part) {
    return counters.bytes_used + options.graph_bytes_limit / part > options.graph_bytes_limit;
  };
  if (!free_below(kFullPart)) return;
  graph::Condenser condenser(model);
  while (free_below(kRoomPart)) {
    const std::optional<graph::Condensed> condensed = condenser.step();
    if (!condensed) return;
    settled = false;
    search.forget(condensed->submap);
    ++(condensed->state == SubmapState::kFrozen ? counters.submaps_frozen : counters.submaps_condensed);
    condensed_loops += condensed->confirmed_loops;
    rejected_pending += condensed->pending_loops;
    count();
  }
}

std::vector<Loop> Optimizer::Impl::loops() const {
  std::vector<Loop> all;
  for (const LoopRecord& record : model.loops) all.push_back(record.loop);
  return all;
}

Status Optimizer::Impl::take(const std::shared_ptr<const FinishedSubmap>& newest) {
  if (Status status = check(newest.get(), model.submaps.size()); !status.ok()) return status;
  const FinishedSubmap& submap = *newest;
  const auto index = static_cast<std::uint32_t>(model.submaps.size());
  graph::SubmapRecord record = graph::make_record(submap, tools.make_outline(submap));
  graph::ChainLink link;
  Pose2 pose = submap.odom_from_submap;
  if (index > 0) {
    link = graph::make_link(model.submaps.back(), record, submap.linked_to_previous);
    pose = compose(model.poses.back(), link.edge.mean);
  }
  model.submaps.push_back(std::move(record));
  model.links.push_back(std::move(link));
  model.poses.push_back(pose);
  settled = false;
  count();
  if (model.links.back().linked) model.links.back().landmarks = search.tie_neighbours(model, newest, bytes_left());
  count();
  return {};
}

// Those between the newest sub-map and earlier ones; returns which loops they are.
std::vector<std::size_t> Optimizer::Impl::add_manual_ties() {
  std::vector<std::size_t> added;
  const auto newest = static_cast<std::uint32_t>(model.submaps.size() - 1);
  for (const ManualTie& tie : options.edits.ties) {
    if (tie.b != newest || tie.a >= tie.b || model.submaps[tie.a].condensed()) continue;
    added.push_back(model.loops.size());
    model.loops.push_back(graph::tie_record(model, tie));
  }
  count();
  return added;
}

void Optimizer::Impl::seek_live() {
  const graph::RelativeUncertainty uncertainty(model);
  const auto newest = static_cast<std::uint32_t>(model.submaps.size() - 1);
  const auto ranked = search.untried(model, uncertainty, newest, kLiveGap);
  for (const LoopCandidate& candidate : graph::LoopSearch::spread_out(model, ranked, kLiveRuns)) {
    if (cancelled->load()) return;
    search.run(model, candidate, bytes_left());
    count();
  }
}

// Every pair that overlaps at the poses then known, most informative first, in batches after each of which the graph
// learns. `budget` in matcher runs.
void Optimizer::Impl::seek_all(std::size_t budget, bool accept_lone) {
  const std::size_t batch = std::max<std::size_t>(kLiveRuns, 2 * retained());
  // What is found could not be kept without room.
  const auto has_room = [this] { return bytes_left() > sizeof(LoopRecord); };
  while (budget > 0 && has_room() && !cancelled->load()) {
    const graph::RelativeUncertainty uncertainty(model);
    std::vector<LoopCandidate> ranked;
    for (std::uint32_t b = kFinalGap; b < model.submaps.size(); ++b) {
      if (model.submaps[b].condensed()) continue;
      const auto of_b = search.untried(model, uncertainty, b, kFinalGap);
      ranked.insert(ranked.end(), of_b.begin(), of_b.end());
    }
    std::stable_sort(ranked.begin(), ranked.end(),
                     [](const LoopCandidate& p, const LoopCandidate& q) { return p.value > q.value; });
    if (ranked.size() > std::min(batch, budget)) ranked.resize(std::min(batch, budget));
    if (ranked.empty()) return;
    // In order of index, so that a cache of loaded sub-maps helps.
    std::stable_sort(ranked.begin(), ranked.end(), [](const LoopCandidate& p, const LoopCandidate& q) {
      return std::pair(p.b, p.a) < std::pair(q.b, q.a);
    });
    const std::uint64_t before = search.runs();
    for (const LoopCandidate& candidate : ranked) {
      if (cancelled->load()) return;
      if (!has_room()) break;
      search.run(model, candidate, bytes_left());
      count();
    }
    if (search.runs() == before) return;  // nothing can be loaded
    budget -= ranked.size();
    // A failed solve keeps the poses; the final one reports it.
    if (!settle(accept_lone).ok()) return;
  }
}

Status Optimizer::Impl::solve(const std::vector<std::size_t>& news) {
  const auto start = std::chrono::steady_clock::now();
  const auto summary = graph::solve_live(model, news, cancelled.get());
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
  ++counters.solves;
  ++version;
  counters.solve_ms_max = std::max(counters.solve_ms_max, took.count());
  return summary ? Status{} : summary.error();
}

// Confirms and solves until nothing changes any more.
Status Optimizer::Impl::settle(bool accept_lone) {
  const auto solve_with = [this](const std::vector<std::size_t>& news) { return solve(news); };
  const bool solved = std::exchange(settled, false);
  if (Status status = graph::settle_loops(model, accept_lone, solved, solve_with); !status.ok()) return status;
  settled = true;
  count();
  return {};
}

Optimizer::Optimizer(const OptimizerOptions& options, SubmapSource& source, PairTools tools)
    : impl_(std::make_unique<Impl>(options, source, std::move(tools))) {}

Optimizer::~Optimizer() = default;

Expected<GraphState> Optimizer::add_submap(const std::shared_ptr<const FinishedSubmap>& submap) {
  if (Status status = check(submap.get(), impl_->model.submaps.size()); !status.ok()) return failure(status);
  impl_->hold_budget();  // a map that was saved since may have filled it with loops
  if (Status status = impl_->take(submap); !status.ok()) return failure(status);
  if (const auto ties = impl_->add_manual_ties(); !ties.empty()) {
    if (Status status = impl_->solve(ties); !status.ok()) return failure(status);
  }
  if (impl_->options.loops) impl_->seek_live();
  if (Status status = impl_->settle(false); !status.ok()) return failure(status);
  impl_->hold_budget();
  GraphState state;
  state.version = impl_->version;
  for (std::uint32_t k = 0; k < impl_->model.poses.size(); ++k) {
    state.submaps.push_back({k, impl_->model.poses[k], impl_->model.submaps[k].state});
  }
  state.loops = impl_->loops();
  return state;
}

Expected<FinalResult> Optimizer::Impl::finish(std::size_t runs) {
  if (model.submaps.empty())
    return failure(StatusCode::kNotFound, "optimizer: no sub-map yet; there is nothing to solve");
  if (options.loops) {
    seek_all(runs, true);
    if (cancelled->load()) return failure(StatusCode::kUnavailable, "optimizer: the program ends");
    if (Status status = settle(true); !status.ok()) return failure(status);
    rejected_pending += static_cast<std::uint64_t>(graph::reject_contradicted(model));
    count();
  }
  archive.release();  // the solver needs the room
  search.release();
  graph::TrackGraph track = graph::build_track_graph(model);
  const auto start = std::chrono::steady_clock::now();
  const auto summary = graph::solve_track_graph(track, options.parts.robust_loss, cancelled.get());
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
  ++counters.solves;
  counters.solve_ms_max = std::max(counters.solve_ms_max, took.count());
  if (!summary) return failure(summary.error());

  FinalResult result;
  result.graph = graph::export_graph(track);
  const graph::RelativeUncertainty uncertainty(model);
  const graph::RelativePoses paths = uncertainty.paths_from(0);
  for (std::uint32_t k = 0; k < model.submaps.size(); ++k) {
    const std::uint32_t first = track.first_of_submap[k];
    const bool solved = first != graph::kNoTrackPoint;
    result.submaps.push_back({k, solved ? track.track[first].map_from_base : Pose2{}});
    result.bounds.push_back(solved ? SubmapBound{track.track[first].stamp_us, paths[k].pose.covariance}
                                   : SubmapBound{});
  }
  result.loops = loops();
  const OptimizerCounters& counted = counters;
  result.report = fmt::format(
      "{} sub-maps, {} of them condensed, {} frozen; {} track points, {} landmarks, {} rows\n"
      "loops: {} matched, {} confirmed, {} pending, {} refused; {} refused for memory, {} loads failed\n"
      "final solve: cost {:.6g} -> {:.6g} in {} iterations\n",
      counted.submaps, counted.submaps_condensed, counted.submaps_frozen, track.track.size(), track.landmarks.size(),
      track.chain.size() + track.sights.size(), counted.loop_candidates, counted.loops_confirmed, counted.loops_pending,
      counted.loops_rejected, counted.refused_for_memory, search.load_failures(), summary->initial_cost,
      summary->final_cost, summary->iterations);
  result.keyframes = std::move(track.track);
  graph::hang_condensed(model, result);
  result.ties = graph::stress_of(model, result.submaps);
  if (options.suspects) result.suspects = graph::suspects_of(model, tools, search, result.ties);
  return result;
}

Expected<FinalResult> Optimizer::finish() {
  return impl_->finish(kFinalRunsPerSubmap * impl_->retained());
}

Expected<FinalResult> Optimizer::finish_with(const std::shared_ptr<const FinishedSubmap>& open) {
  if (Status status = check(open.get(), impl_->model.submaps.size()); !status.ok()) return failure(status);
  // What the live graph learns here the next saved map need not seek again; what only the end of a run may take for
  // granted (a lone loop) stays in the copy.
  if (impl_->options.loops && !impl_->model.submaps.empty()) impl_->seek_all(kSaveRuns, false);
  WithOpenSubmap source(impl_->archive, open);
  Impl copy(*impl_, source);
  if (Status status = copy.take(open); !status.ok()) return failure(status);
  return copy.finish(kFinalRunsPerSubmap);
}

Eigen::Matrix3d covariance_bound(const FinalResult& result, std::int64_t stamp_us, const Pose2& map_from_base) {
  const auto later =
      std::upper_bound(result.bounds.begin(), result.bounds.end(), stamp_us,
                       [](std::int64_t stamp, const SubmapBound& bound) { return stamp < bound.begun_us; });
  if (later == result.bounds.begin()) return Eigen::Matrix3d::Zero();
  const auto k = static_cast<std::size_t>(later - result.bounds.begin()) - 1;
  const Pose2& map_from_submap = result.submaps[k].map_from_submap;
  const graph::UncertainPose within{between(map_from_submap, map_from_base), Eigen::Matrix3d::Zero()};
  return compose(graph::UncertainPose{map_from_submap, result.bounds[k].covariance}, within).covariance;
}

void Optimizer::cancel() {
  impl_->cancelled->store(true);
}

OptimizerCounters Optimizer::counters() const {
  return impl_->counters;
}

}  // namespace submapd
