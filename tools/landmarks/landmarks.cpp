#include "tools/landmarks/landmarks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "daemon/version.hpp"
#include "slam/graph/point_pairs.hpp"
#include "slam/landmark/landmark_selection.hpp"
#include "slam/loop/submap_matcher.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/output/run_outputs.hpp"
#include "tools/replay/replay_report.hpp"

namespace submapd::tools {
namespace {

constexpr double kRawSigma_m = 0.10;      // of a spot that a person pointed at
constexpr double kSnappedSigma_m = 0.02;  // of a landmark where the matcher agrees
// Within what the matcher looks for the better place: three sigma.
constexpr double kSnapSigma_m = 0.3;
constexpr double kSnapSigma_rad = 0.05;
constexpr double kFarSnap_m = 0.3;     // told
constexpr double kWorstSpot_m = 0.5;   // pairs that fit each other worse are no pairs
constexpr double kBroken = 4.03;       // sigmas of a relative pose, 99.9 % of three degrees of freedom
constexpr double kNoticeable = 0.5;    // sigmas by which a tie must change to be told
constexpr std::size_t kMostTold = 20;  // ties, suspects

SubmapPair ordered(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

Status check_pair(const EditedRun& run, std::uint32_t a, std::uint32_t b) {
  if (a != b && std::max(a, b) < run.submaps()) return {};
  return {StatusCode::kInvalidArgument,
          fmt::format("{} and {} are no two of the run's sub-maps 0 to {}", a, b, run.submaps() - 1)};
}

std::string_view words_of(SuspectPair::Kind kind) {
  switch (kind) {
    case SuspectPair::Kind::kUntied:
      return "not tied";
    case SuspectPair::Kind::kPending:
      return "pending";
    case SuspectPair::Kind::kStrained:
      return "strained";
  }
  return "?";
}

// --- add ----------------------------------------------------------------------------------------------------------

// The tie as it would be committed, and what was found on the way to it.
struct Proposal {
  ManualTie tie;
  std::string text;
  bool sound = true;
};

std::vector<TiePoint> points_in_submaps(const AddOptions& add, const FinalResult& solved) {
  std::vector<TiePoint> points;
  for (const SpotPair& spot : add.spots) {
    TiePoint point{spot.seen_in_a, spot.seen_in_b};
    if (add.in_map) {
      point.in_a = transform(inverse(solved.submaps[add.a].map_from_submap), point.in_a);
      point.in_b = transform(inverse(solved.submaps[add.b].map_from_submap), point.in_b);
    }
    if (add.a > add.b) std::swap(point.in_a, point.in_b);
    points.push_back(point);
  }
  return points;
}

// Lets the matcher find the place near by: landmarks of both maps instead of a person's spots.
Status snap(EditedRun& run, const PointPairPose& start, Proposal& proposal) {
  const auto a = run.archive().load(proposal.tie.a);
  if (!a) return a.error();
  const auto b = run.archive().load(proposal.tie.b);
  if (!b) return b.error();
  MatchPrior prior{start.a_from_b, start.covariance};
  prior.covariance.diagonal() +=
      Eigen::Vector3d(kSnapSigma_m * kSnapSigma_m, kSnapSigma_m * kSnapSigma_m, kSnapSigma_rad * kSnapSigma_rad);
  SubmapMatch match = SubmapMatcher{SubmapMatcherOptions{}}.search(**a, **b, prior);
  match.a = proposal.tie.a;
  match.b = proposal.tie.b;
  proposal.text +=
      fmt::format("matching: score {:.2f}, overlap {:.0f} m2, contradiction {:.1f} %, second peak {:.2f}\n",
                  match.score, match.overlap_m2, 100.0 * match.contradiction, match.second_peak);
  std::vector<VirtualLandmark> landmarks;
  if (match.verdict == MatchVerdict::kAccepted) landmarks = choose_landmarks(**a, **b, match, LandmarkOptions{});
  std::vector<TiePoint> points;
  for (const VirtualLandmark& landmark : landmarks) {
    if (points.size() < kMaxTiePoints) points.push_back({landmark.in_a, landmark.in_b});
  }
  if (!relative_pose_of(points, kSnappedSigma_m)) {
    proposal.sound = false;
    proposal.text +=
        "refused: the two maps do not fit there; look again, or commit the points as they are (--no-snap)\n";
    return {};
  }
  const Pose2 moved = between(start.a_from_b, match.a_from_b);
  proposal.text += fmt::format("matching moves sub-map {} by {:.2f} m and {:.1f} deg from where the points have it{}\n",
                               proposal.tie.b, moved.translation().norm(), moved.yaw * 180.0 / std::numbers::pi,
                               moved.translation().norm() > kFarSnap_m ? ": that is far, look at it" : "");
  proposal.tie.points = std::move(points);
  proposal.tie.sigma_m = kSnappedSigma_m;
  return {};
}

Expected<Proposal> propose(EditedRun& run, const AddOptions& add, const FinalResult& solved) {
  if (add.spots.size() > kMaxTiePoints) {
    return failure(StatusCode::kInvalidArgument, fmt::format("{} points; {} at most", add.spots.size(), kMaxTiePoints));
  }
  Proposal proposal;
  std::tie(proposal.tie.a, proposal.tie.b) = ordered(add.a, add.b);
  proposal.tie.sigma_m = kRawSigma_m;
  proposal.tie.points = points_in_submaps(add, solved);
  const Expected<PointPairPose> start = relative_pose_of(proposal.tie.points, kRawSigma_m);
  if (!start) return failure(start.error());
  for (std::size_t k = 0; k < start->residual_m.size(); ++k) {
    proposal.text += fmt::format("point {}: {:.3f} m off\n", k + 1, start->residual_m[k]);
    if (start->residual_m[k] > kWorstSpot_m) proposal.sound = false;
  }
  if (!proposal.sound) {
    proposal.text += fmt::format("refused: the points do not fit each other to {:.1f} m\n", kWorstSpot_m);
    return proposal;
  }
  if (add.snap) {
    if (Status status = snap(run, *start, proposal); !status.ok()) return failure(status);
  }
  return proposal;
}

// What of the ties changes, and whether any breaks that did not before.
struct Trial {
  std::string text;
  bool breaks = false;
};

Trial compare(const FinalResult& before, const FinalResult& after, const SubmapPair& added) {
  Trial trial;
  std::map<SubmapPair, double> sigmas_before;
  for (const TieStress& tie : before.ties) sigmas_before[{tie.a, tie.b}] = tie.sigmas;
  const bool is_there = std::any_of(after.ties.begin(), after.ties.end(),
                                    [&](const TieStress& tie) { return SubmapPair(tie.a, tie.b) == added; });
  if (!is_there) {
    trial.breaks = true;
    trial.text += "the tie is no part of the graph: one of the two was condensed for want of [budget] graph\n";
  }
  struct Change {
    SubmapPair pair;
    double before = 0.0;
    double after = 0.0;
    double off_m = 0.0;
    bool link = false;
  };
  std::vector<Change> changes;
  for (const TieStress& tie : after.ties) {
    const SubmapPair pair(tie.a, tie.b);
    const auto found = sigmas_before.find(pair);
    if (pair == added) {
      trial.text += fmt::format("the new tie: {:.2f} m, {:.1f} sigma from the solution\n", tie.off_m, tie.sigmas);
      if (tie.sigmas > kBroken) {
        trial.breaks = true;
        trial.text += "  it does not hold: the other ties contradict it\n";
      }
      continue;
    }
    if (found == sigmas_before.end()) continue;
    if (std::abs(tie.sigmas - found->second) >= kNoticeable) {
      changes.push_back({pair, found->second, tie.sigmas, tie.off_m, tie.link});
    }
    sigmas_before.erase(found);
  }
  std::stable_sort(changes.begin(), changes.end(), [](const Change& p, const Change& q) { return p.after > q.after; });
  for (std::size_t k = 0; k < changes.size(); ++k) {
    const Change& c = changes[k];
    const bool broken = c.after > kBroken && c.after > c.before;
    trial.breaks = trial.breaks || broken;
    if (k < kMostTold) {
      trial.text += fmt::format("{} {:3} - {:3}: {:5.1f} -> {:5.1f} sigma, {:.2f} m off{}\n", c.link ? "link" : "loop",
                                c.pair.first, c.pair.second, c.before, c.after, c.off_m, broken ? "  BREAKS" : "");
    }
  }
  if (changes.size() > kMostTold) trial.text += fmt::format("... and {} more\n", changes.size() - kMostTold);
  sigmas_before.erase(added);
  for (const auto& [pair, sigmas] : sigmas_before) {
    trial.breaks = true;
    trial.text += fmt::format("loop {:3} - {:3}: no longer confirmed  BREAKS\n", pair.first, pair.second);
  }
  double most_m = 0.0;
  std::size_t most = 0;
  for (std::size_t k = 0; k < std::min(before.submaps.size(), after.submaps.size()); ++k) {
    const double moved_m =
        (after.submaps[k].map_from_submap.translation() - before.submaps[k].map_from_submap.translation()).norm();
    if (moved_m > most_m) most_m = moved_m, most = k;
  }
  trial.text += fmt::format("sub-maps move by up to {:.2f} m (number {})\n", most_m, most);
  return trial;
}

Expected<LandmarksAnswer> bar(const LandmarksOptions& options, std::uint32_t a, std::uint32_t b, bool forbid) {
  Expected<EditedRun> run = EditedRun::open(options.run, options.configuration);
  if (!run) return failure(run.error());
  if (Status status = check_pair(*run, a, b); !status.ok()) return failure(status);
  const SubmapPair pair = ordered(a, b);
  const EditList edits = run->edits();
  if (edits.forbidden.contains(pair)) {
    return LandmarksAnswer{fmt::format("sub-maps {} and {} are forbidden already\n", pair.first, pair.second), false};
  }
  const JournalEvent event = forbid ? JournalEvent(PairForbidden{pair.first, pair.second})
                                    : JournalEvent(PairRemoved{pair.first, pair.second});
  if (Status status = run->append(event); !status.ok()) return failure(status);
  return LandmarksAnswer{fmt::format("{}; `landmarks solve` writes the map without it\n", *tools::words_of(event)),
                         true};
}

}  // namespace

Expected<LandmarksAnswer> list_suspects(const LandmarksOptions& options) {
  Expected<EditedRun> run = EditedRun::open(options.run, options.configuration);
  if (!run) return failure(run.error());
  const EditList edits = run->edits();
  const Expected<FinalResult> solved = run->solve(edits.graph, options.loops, options.progress);
  if (!solved) return failure(solved.error());
  LandmarksAnswer answer;
  for (const JournalEvent& edit : edits.edits) answer.text += fmt::format("edit: {}\n", *tools::words_of(edit));
  std::size_t told = 0;
  for (const SuspectPair& suspect : solved->suspects) {
    if (edits.forbidden.contains({suspect.a, suspect.b})) continue;
    if (told == 0) answer.text += "   a    b  what       effect m  gain nat  sigmas\n";
    if (++told > kMostTold) continue;
    const auto number = [](double value, int digits) {
      return value > 0.0 ? fmt::format("{:.{}f}", value, digits) : std::string("-");
    };
    answer.text += fmt::format("{:4} {:4}  {:9} {:>9} {:>9} {:>7}\n", suspect.a, suspect.b, words_of(suspect.kind),
                               number(suspect.effect_m, 2), number(suspect.gain_nats, 1), number(suspect.sigmas, 1));
  }
  answer.text += told == 0 ? "no suspects\n" : fmt::format("{} suspects\n", told);
  return answer;
}

Expected<LandmarksAnswer> add_tie(const LandmarksOptions& options, const AddOptions& add) {
  Expected<EditedRun> run = EditedRun::open(options.run, options.configuration);
  if (!run) return failure(run.error());
  if (Status status = check_pair(*run, add.a, add.b); !status.ok()) return failure(status);
  const SubmapPair pair = ordered(add.a, add.b);
  const EditList edits = run->edits();
  LandmarksAnswer refused{"", false};
  if (edits.forbidden.contains(pair)) {
    refused.text = fmt::format("refused: sub-maps {} and {} are forbidden; undo that first\n", pair.first, pair.second);
    return refused;
  }
  const Expected<FinalResult> before = run->solve(edits.graph, options.loops, options.progress);
  if (!before) return failure(before.error());
  const Expected<Proposal> proposal = propose(*run, add, *before);
  if (!proposal) return failure(proposal.error());
  refused.text = proposal->text;
  if (!proposal->sound) return refused;
  GraphEdits with_tie = edits.graph;
  set_tie(with_tie, proposal->tie);
  const Expected<FinalResult> after = run->solve(with_tie, options.loops, options.progress);
  if (!after) return failure(after.error());
  const Trial trial = compare(*before, *after, pair);
  refused.text += trial.text;
  if (trial.breaks && !add.force) {
    refused.text += "refused: ties would break; remove the wrong ones first, or commit it all the same (--force)\n";
    return refused;
  }
  const JournalEvent event = LandmarksAdded{proposal->tie};
  if (Status status = run->append(event); !status.ok()) return failure(status);
  return LandmarksAnswer{refused.text + fmt::format("committed: {}\n", *tools::words_of(event)), true};
}

Expected<LandmarksAnswer> remove_tie(const LandmarksOptions& options, std::uint32_t a, std::uint32_t b) {
  return bar(options, a, b, false);
}

Expected<LandmarksAnswer> forbid_tie(const LandmarksOptions& options, std::uint32_t a, std::uint32_t b) {
  return bar(options, a, b, true);
}

Expected<LandmarksAnswer> undo_edit(const LandmarksOptions& options) {
  Expected<EditedRun> run = EditedRun::open(options.run, options.configuration);
  if (!run) return failure(run.error());
  const EditList edits = run->edits();
  if (edits.edits.empty()) return LandmarksAnswer{"there is no edit to undo\n", false};
  if (Status status = run->append(EditUndone{}); !status.ok()) return failure(status);
  return LandmarksAnswer{fmt::format("undone: {}\n", *tools::words_of(edits.edits.back())), true};
}

Expected<LandmarksAnswer> solve_run(const LandmarksOptions& options, const std::filesystem::path& out) {
  Expected<EditedRun> run = EditedRun::open(options.run, options.configuration);
  if (!run) return failure(run.error());
  std::error_code error;
  if (!std::filesystem::is_regular_file(run->folder() / "poses", error)) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{}: is missing; the run's scans have no poses", (run->folder() / "poses").string()));
  }
  const EditList edits = run->edits();
  const Expected<FinalResult> solved = run->solve(edits.graph, options.loops, options.progress);
  if (!solved) return failure(solved.error());
  const Expected<std::unique_ptr<PoseSpool>> poses = PoseSpool::open(run->folder() / "poses");
  if (!poses) return failure(poses.error());
  std::filesystem::create_directories(out, error);
  if (error) {
    return failure(StatusCode::kIo, fmt::format("cannot make the folder {}: {}", out.string(), error.message()));
  }
  const RunOutputs outputs{.folder = out,
                           .name = std::filesystem::absolute(run->folder()).lexically_normal().filename().string(),
                           .subtitle = fmt::format("submapd {}, {} edits", kVersion, edits.edits.size()),
                           .mapper = options.configuration.mapper,
                           .raster_bytes = options.configuration.map_raster_bytes,
                           .result = *solved,
                           .submaps = run->archive(),
                           .poses = **poses,
                           .scans = (*poses)->size(),
                           .marks = {}};
  const Expected<RunOutputsSummary> written = write_run_outputs(outputs);
  if (!written) return failure(written.error());
  if (Status status = write_replay_report(out / "report.json", written->quality, *solved); !status.ok()) {
    return failure(status);
  }
  const auto confirmed = std::count_if(solved->loops.begin(), solved->loops.end(),
                                       [](const Loop& loop) { return loop.state == LoopState::kConfirmed; });
  return LandmarksAnswer{
      fmt::format("{} sub-maps, {} ties between distant ones, {} of them by hand\nmap: {}\n", solved->submaps.size(),
                  confirmed, edits.graph.ties.size(), (out / "map.png").string()),
      true};
}

}  // namespace submapd::tools
