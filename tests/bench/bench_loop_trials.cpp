// Loop trials on the sub-maps of replayed runs with known truth (loop_trials.hpp): how often the matcher accepts a
// false place, how often the policy confirms one, how many of the true ones are found. JSON on stdout, words on stderr.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slam/output/trajectory_file.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tests/bench/loop_trials.hpp"

namespace submapd::bench {
namespace {

constexpr std::array<const char*, kTrialKinds> kKindNames = {"overlapping", "apart", "deceived"};
constexpr std::int64_t kLongestGap_us = 1'000'000;  // of the truth that is interpolated over
constexpr std::size_t kCacheBytes = 0;              // all are kept anyway

struct Arguments {
  std::vector<std::string> runs;  // RUN TRUTH ...
  std::vector<std::string> aliases;
  std::uint64_t seed = 1;
  std::uint64_t trials = 100;
};

const char* name_of(MatchVerdict verdict) {
  constexpr std::array names = {"accepted",      "no peak",   "low score",  "small overlap",
                                "contradiction", "ambiguous", "asymmetric", "gate"};
  return names[static_cast<std::size_t>(verdict)];
}

std::optional<Pose2> pose_at(const std::vector<StampedPose>& truth, std::int64_t stamp_us) {
  const auto later =
      std::lower_bound(truth.begin(), truth.end(), stamp_us,
                       [](const StampedPose& pose, std::int64_t stamp) { return pose.stamp_us < stamp; });
  if (later == truth.end()) return std::nullopt;
  if (later->stamp_us == stamp_us) return later->pose;
  if (later == truth.begin() || later->stamp_us - (later - 1)->stamp_us > kLongestGap_us) return std::nullopt;
  const StampedPose& before = *(later - 1);
  return interpolate(
      before.pose, later->pose,
      static_cast<double>(stamp_us - before.stamp_us) / static_cast<double>(later->stamp_us - before.stamp_us));
}

Expected<TrialRun> read_run(const std::filesystem::path& folder, const std::filesystem::path& truth_file,
                            std::uint64_t number) {
  const std::filesystem::path submaps = folder / "submaps";
  if (!std::filesystem::is_directory(submaps)) {
    return failure(StatusCode::kNotFound, submaps.string() + ": no such folder; give one that a replay has left");
  }
  const auto truth = read_tum(truth_file);
  if (!truth) return failure(truth.error());
  const auto archive = SubmapArchive::open(submaps, kCacheBytes);
  if (!archive) return failure(archive.error());
  TrialRun run;
  run.number = number;
  for (std::uint32_t index = 0; std::filesystem::exists((*archive)->path_of(index)); ++index) {
    const auto submap = (*archive)->load(index);
    if (!submap) return failure(submap.error());
    const std::optional<Pose2> pose = pose_at(*truth, (*submap)->keyframes.front().stamp_us);
    if (!pose) {
      return failure(StatusCode::kInvalidArgument,
                     fmt::format("{}: nothing at {} s, where sub-map {} begins", truth_file.string(),
                                 seconds_text((*submap)->keyframes.front().stamp_us), index));
    }
    run.submaps.push_back(*submap);
    run.world_from_submap.push_back(*pose);
  }
  return run;
}

struct Tally {
  int trials = 0;
  int accepted = 0;
  int false_accepted = 0;
  int confirmed = 0;        // the trial's own pair
  int loops_confirmed = 0;  // of the trials' graphs
  int false_confirmed = 0;  // of them
  int unambiguous = 0;
  int found = 0;                      // unambiguous ones accepted where they are
  int found_confirmed = 0;            // and confirmed
  std::map<std::string, int> missed;  // unambiguous ones, by verdict and whether the matcher had the right place
};

class Report {
 public:
  void note(const std::string& run_name, const TrialGround& ground, const Trial& trial, const TrialResult& result) {
    Tally& tally = tallies_[static_cast<std::size_t>(trial.kind)];
    const bool wrong = is_false(trial.a_from_b, result.match.a_from_b);
    ++tally.trials;
    tally.accepted += result.accepted ? 1 : 0;
    tally.false_accepted += result.accepted && wrong ? 1 : 0;
    tally.confirmed += result.confirmed ? 1 : 0;
    tally.loops_confirmed += static_cast<int>(result.loops_confirmed);
    tally.false_confirmed += static_cast<int>(result.wrong_confirmed.size());
    if (trial.unambiguous) {
      ++tally.unambiguous;
      tally.found += result.accepted && !wrong ? 1 : 0;
      tally.found_confirmed += result.confirmed && !wrong ? 1 : 0;
      if (!result.accepted || wrong) {
        ++tally.missed[std::string(name_of(result.match.verdict)) + (wrong ? " elsewhere" : " in place")];
      }
    }
    trials_.push_back(described(run_name, ground, trial, result));
  }

  [[nodiscard]] nlohmann::json json(const Arguments& arguments, std::uint64_t not_drawn) const {
    nlohmann::json all = {{"seed", arguments.seed}, {"not_drawn", not_drawn}, {"trials", trials_}};
    for (std::size_t kind = 0; kind < tallies_.size(); ++kind) {
      const Tally& tally = tallies_[kind];
      all[kKindNames[kind]] = {{"trials", tally.trials},
                               {"accepted", tally.accepted},
                               {"false_accepted", tally.false_accepted},
                               {"confirmed", tally.confirmed},
                               {"loops_confirmed", tally.loops_confirmed},
                               {"false_confirmed", tally.false_confirmed},
                               {"unambiguous", tally.unambiguous},
                               {"found", tally.found},
                               {"found_confirmed", tally.found_confirmed},
                               {"missed", tally.missed}};
    }
    return all;
  }

  [[nodiscard]] std::string words() const {
    std::string text;
    for (std::size_t kind = 0; kind < tallies_.size(); ++kind) {
      const Tally& t = tallies_[kind];
      text += fmt::format("{:12} {:5} trials; accepted {:5}, {} of them false; confirmed {:5}, {} of {} loops false",
                          kKindNames[kind], t.trials, t.accepted, t.false_accepted, t.confirmed, t.false_confirmed,
                          t.loops_confirmed);
      if (t.unambiguous > 0) {
        const double all = t.unambiguous;
        text += fmt::format("\n{:12} {:5} of them unambiguous: {:.3f} accepted, {:.3f} confirmed; missed:", "",
                            t.unambiguous, t.found / all, t.found_confirmed / all);
        for (const auto& [why, count] : t.missed) text += fmt::format(" {} {},", count, why);
      }
      text += "\n";
    }
    return text;
  }

 private:
  static nlohmann::json described(const std::string& run_name, const TrialGround& ground, const Trial& trial,
                                  const TrialResult& result) {
    const Pose2& at = ground.ground().world_from_submap[trial.b];
    nlohmann::json wrong = nlohmann::json::array();
    for (const WrongLoop& loop : result.wrong_confirmed) {
      wrong.push_back({{"a", loop.a}, {"b", loop.b}, {"off_m", loop.off_m}, {"off_rad", loop.off_rad}});
    }
    return {{"run", run_name},
            {"kind", kKindNames[static_cast<std::size_t>(trial.kind)]},
            {"a", trial.a},
            {"b", trial.b},
            {"b_at_m", {at.x, at.y}},
            {"sigma_m", trial.sigma_m},
            {"unambiguous", trial.unambiguous},
            {"overlap_m2", trial.overlap_m2},
            {"structure", trial.structure},
            {"verdict", name_of(result.match.verdict)},
            {"score", result.match.score},
            {"overlap_share", result.match.overlap_share},
            {"contradiction", result.match.contradiction},
            {"second_peak", result.match.second_peak},
            {"weak", result.match.weak},
            {"off_m", result.off_m},
            {"off_rad", result.off_rad},
            {"confirmed", result.confirmed},
            {"wrong_confirmed", wrong}};
  }

  std::array<Tally, kTrialKinds> tallies_;
  nlohmann::json trials_ = nlohmann::json::array();
};

Expected<std::vector<Eigen::Vector2d>> read_aliases(const std::vector<std::string>& words) {
  std::vector<Eigen::Vector2d> aliases;
  for (const std::string& word : words) {
    Eigen::Vector2d alias;
    char end = 0;
    if (std::sscanf(word.c_str(), "%lf,%lf%c", &alias.x(), &alias.y(), &end) != 2) {
      return failure(StatusCode::kInvalidArgument, "--alias " + word + ": not DX,DY in metres");
    }
    aliases.push_back(alias);
  }
  return aliases;
}

Status run_all(const Arguments& arguments) {
  if (arguments.runs.size() % 2 != 0) {
    return {StatusCode::kInvalidArgument, "give a truth (TUM) after each run's folder"};
  }
  const auto aliases = read_aliases(arguments.aliases);
  if (!aliases) return aliases.error();
  fmt::print(stderr, "seed {}, {} trials a run\n", arguments.seed, arguments.trials);
  Report report;
  std::uint64_t not_drawn = 0;
  for (std::size_t k = 0; k < arguments.runs.size(); k += 2) {
    auto run = read_run(arguments.runs[k], arguments.runs[k + 1], k / 2);
    if (!run) return run.error();
    const TrialGround ground(std::move(*run), {arguments.seed, *aliases});
    fmt::print(stderr, "{}: {} sub-maps; pairs: {} overlapping, {} apart, {} that look alike\n", arguments.runs[k],
               ground.ground().submaps.size(), ground.pairs(TrialKind::kOverlapping), ground.pairs(TrialKind::kApart),
               ground.pairs(TrialKind::kDeceived));
    // Two of three overlap. What a lie does is looked at besides, a quarter as often.
    const std::uint64_t lies = aliases->empty() ? 0 : arguments.trials / 4;
    for (std::uint64_t number = 0; number < arguments.trials + lies; ++number) {
      const TrialKind kind = number >= arguments.trials ? TrialKind::kDeceived
                             : number % 3 == 2          ? TrialKind::kApart
                                                        : TrialKind::kOverlapping;
      const std::optional<Trial> trial = ground.draw(kind, number);
      if (trial) {
        report.note(arguments.runs[k], ground, *trial, ground.run(*trial));
      } else {
        ++not_drawn;
      }
    }
  }
  fmt::print(stderr, "{}", report.words());
  if (not_drawn > 0) fmt::print(stderr, "{} could not be drawn: no such pair is let in\n", not_drawn);
  fmt::print("{}\n", report.json(arguments, not_drawn).dump());
  return {};
}

}  // namespace
}  // namespace submapd::bench

int main(int argc, char** argv) {
  submapd::bench::Arguments arguments;
  CLI::App app("Loop trials on the sub-maps of replayed runs with known truth");
  app.add_option("RUN", arguments.runs, "Folder of a replay, then its truth (TUM); as many such pairs as you like")
      ->required();
  app.add_option("--trials", arguments.trials, "Trials of each run")->capture_default_str();
  app.add_option("--seed", arguments.seed, "Seed of what is drawn")->capture_default_str();
  app.add_option("--alias", arguments.aliases, "DX,DY: a translation that carries the world onto itself, m")
      ->allow_extra_args(false);
  CLI11_PARSE(app, argc, argv);
  const submapd::Status status = submapd::bench::run_all(arguments);
  if (status.ok()) return 0;
  fmt::print(stderr, "bench_loop_trials: {}\n", status.message());
  return status.code() == submapd::StatusCode::kInvalidArgument ? 2 : 1;
}
