#include "slam/graph/internal/loop_search.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "slam/graph/internal/least_squares.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd::graph {
namespace {

// A pair is tried again when its prior has moved by as much as the narrowest window is wide.
constexpr double kRetryM = 1.0;
constexpr double kRetryRad = 5.0 * kDegree;
constexpr std::size_t kMinLandmarks = 2;  // fewer do not fix a pose
constexpr std::size_t kViewBytes = 8U << 20;

Eigen::Vector2d place_of(const std::vector<VirtualLandmark>& landmarks) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const VirtualLandmark& landmark : landmarks) sum += landmark.in_b;
  return sum / static_cast<double>(landmarks.size());
}

// Where the matcher's answer or a landmark could poison every later sum.
bool usable(const SubmapMatch& match) {
  return std::isfinite(match.a_from_b.x) && std::isfinite(match.a_from_b.y) && std::isfinite(match.a_from_b.yaw) &&
         match.covariance.allFinite();
}
bool usable(const GraphModel& model, const VirtualLandmark& landmark, std::uint32_t a, std::uint32_t b) {
  const auto known = [&](std::uint32_t submap, const std::vector<std::uint32_t>& seen_from) {
    return std::all_of(seen_from.begin(), seen_from.end(),
                       [&](std::uint32_t keyframe) { return keyframe < model.submaps[submap].keyframes.size(); });
  };
  return landmark.a == a && landmark.b == b && landmark.in_a.allFinite() && landmark.in_b.allFinite() &&
         whitening(landmark.covariance_a) && whitening(landmark.covariance_b) && !landmark.seen_from_a.empty() &&
         !landmark.seen_from_b.empty() && known(a, landmark.seen_from_a) && known(b, landmark.seen_from_b);
}

}  // namespace

LoopSearch::LoopSearch(const LoopSearch& other, const PairTools& tools, SubmapSource& source)
    : tools_(tools),
      source_(source),
      tried_(other.tried_),
      barred_(other.barred_),
      runs_(other.runs_),
      refused_(other.refused_),
      refused_for_memory_(other.refused_for_memory_),
      load_failures_(other.load_failures_) {}

std::vector<LoopCandidate> LoopSearch::untried(const GraphModel& model, const RelativeUncertainty& uncertainty,
                                               std::uint32_t b, std::uint32_t min_gap) const {
  std::vector<bool> looped(b, false);
  for (const LoopRecord& record : model.loops) {
    if (record.loop.match.b == b) looped[record.loop.match.a] = true;
  }
  return rank_candidates(model, tools_, uncertainty, b, min_gap, [&](std::uint32_t a, const Pose2& a_from_b) {
    if (looped[a] || is_barred(a, b)) return true;
    const auto before = tried_.find({a, b});
    if (before == tried_.end()) return false;
    const Pose2 moved = between(before->second, a_from_b);
    return moved.translation().norm() < kRetryM && std::abs(moved.yaw) < kRetryRad;
  });
}

std::vector<LoopCandidate> LoopSearch::spread_out(const GraphModel& model, const std::vector<LoopCandidate>& ranked,
                                                  std::size_t count) {
  std::vector<LoopCandidate> chosen;
  std::vector<LoopCandidate> crowded;
  const auto place = [&](const LoopCandidate& candidate) {
    return transform(model.poses[candidate.a], model.submaps[candidate.a].outline->centre);
  };
  for (const LoopCandidate& candidate : ranked) {
    const bool apart = std::all_of(chosen.begin(), chosen.end(), [&](const LoopCandidate& other) {
      return (place(candidate) - place(other)).norm() >= kApartM;
    });
    (apart ? chosen : crowded).push_back(candidate);
    if (chosen.size() == count) return chosen;
  }
  for (const LoopCandidate& candidate : crowded) {
    if (chosen.size() == count) break;
    chosen.push_back(candidate);
  }
  return chosen;
}

const SubmapView* LoopSearch::view_of(std::uint32_t index) {
  const auto kept = std::find_if(views_.begin(), views_.end(),
                                 [index](const KeptView& one) { return one.submap->id.index == index; });
  if (kept != views_.end()) {
    views_.splice(views_.begin(), views_, kept);
    return &views_.front().view;
  }
  auto submap = source_.load(index);
  if (!submap || *submap == nullptr) {
    ++load_failures_;
    return nullptr;
  }
  return keep_view(*submap);
}

const SubmapView* LoopSearch::keep_view(const std::shared_ptr<const FinishedSubmap>& submap) {
  views_.push_front({submap, SubmapView(*submap)});
  std::size_t bytes = 0;
  for (auto one = views_.begin(); one != views_.end();) {
    bytes += memory_bytes(*one->submap) + one->view.bytes();
    const bool fits = bytes <= kViewBytes || one == views_.begin() || one == std::next(views_.begin());
    one = fits ? std::next(one) : views_.erase(one);
  }
  return &views_.front().view;
}

void LoopSearch::run(GraphModel& model, const LoopCandidate& candidate, std::size_t bytes_left) {
  const SubmapView* a = view_of(candidate.a);
  const SubmapView* b = view_of(candidate.b);
  if (a == nullptr || b == nullptr) return;
  ++runs_;
  tried_[{candidate.a, candidate.b}] = candidate.prior.a_from_b;
  LoopRecord record;
  record.loop.match = tools_.search(*a, *b, candidate.prior);
  if (record.loop.match.verdict != MatchVerdict::kAccepted || !usable(record.loop.match)) {
    ++refused_;
    return;
  }
  record.loop.match.a = candidate.a;
  record.loop.match.b = candidate.b;
  record.landmarks = tools_.choose_landmarks(*a, *b, record.loop.match);
  std::erase_if(record.landmarks,
                [&](const VirtualLandmark& landmark) { return !usable(model, landmark, candidate.a, candidate.b); });
  record.landmarks.shrink_to_fit();
  if (record.landmarks.size() < kMinLandmarks) {
    ++refused_;
    return;
  }
  if (sizeof(LoopRecord) + bytes_of(record.landmarks) > bytes_left) {
    ++refused_for_memory_;
    return;
  }
  record.place_in_b = place_of(record.landmarks);
  record.window = candidate.window;
  model.loops.push_back(std::move(record));
}

std::vector<VirtualLandmark> LoopSearch::tie_neighbours(const GraphModel& model,
                                                        const std::shared_ptr<const FinishedSubmap>& newest,
                                                        std::size_t bytes_left) {
  const auto b = static_cast<std::uint32_t>(model.links.size() - 1);
  const SubmapView* a = view_of(b - 1);
  if (a == nullptr) return {};
  const SubmapView* b_view = keep_view(newest);
  SubmapMatch match = tools_.refine(*a, *b_view, model.links[b].edge.mean);
  if (match.verdict != MatchVerdict::kAccepted || !usable(match)) return {};
  match.a = b - 1;
  match.b = b;
  std::vector<VirtualLandmark> landmarks = tools_.choose_landmarks(*a, *b_view, match);
  std::erase_if(landmarks, [&](const VirtualLandmark& landmark) { return !usable(model, landmark, b - 1, b); });
  landmarks.shrink_to_fit();
  if (bytes_of(landmarks) > bytes_left) {
    ++refused_for_memory_;
    return {};
  }
  return landmarks;
}

void LoopSearch::forget(std::uint32_t submap) {
  std::erase_if(tried_,
                [submap](const auto& tried) { return tried.first.first == submap || tried.first.second == submap; });
}

std::size_t LoopSearch::bytes() const {
  constexpr std::size_t kTreeNode = 4 * sizeof(void*);
  return tried_.size() * (sizeof(*tried_.begin()) + kTreeNode);
}

}  // namespace submapd::graph
