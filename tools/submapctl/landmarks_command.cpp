// submapctl landmarks: a person's ties in the graph of a finished run.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/landmarks/landmarks.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

struct LandmarksArguments {
  std::string verb;
  std::string run;
  std::vector<std::uint32_t> pair;
  std::vector<std::string> points;
  std::string frame = "map";
  std::string out;
  std::string config;
  bool no_snap = false;
  bool force = false;
  bool no_loops = false;
};

// "AX,AY=BX,BY"
std::optional<SpotPair> parse_spots(const std::string& text) {
  SpotPair spots;
  int used = 0;
  const int fields = std::sscanf(text.c_str(), "%lf,%lf=%lf,%lf%n", &spots.seen_in_a.x(), &spots.seen_in_a.y(),
                                 &spots.seen_in_b.x(), &spots.seen_in_b.y(), &used);
  if (fields != 4 || static_cast<std::size_t>(used) != text.size()) return std::nullopt;
  return spots;
}

Expected<LandmarksAnswer> ask(const LandmarksArguments& arguments, const LandmarksOptions& options) {
  const auto usage = [](std::string text) { return failure(StatusCode::kInvalidArgument, std::move(text)); };
  const bool pairwise = arguments.verb == "add" || arguments.verb == "remove" || arguments.verb == "forbid";
  if (pairwise && arguments.pair.size() != 2) return usage(arguments.verb + " takes the numbers of two sub-maps");
  if (!pairwise && !arguments.pair.empty()) return usage(arguments.verb + " takes no sub-maps");
  if (arguments.verb != "add" && !arguments.points.empty()) return usage("--point belongs to add");
  if (arguments.verb != "solve" && !arguments.out.empty()) return usage("--out belongs to solve");
  if (arguments.verb == "list") return list_suspects(options);
  if (arguments.verb == "undo") return undo_edit(options);
  if (arguments.verb == "remove") return remove_tie(options, arguments.pair[0], arguments.pair[1]);
  if (arguments.verb == "forbid") return forbid_tie(options, arguments.pair[0], arguments.pair[1]);
  if (arguments.verb == "solve") {
    std::error_code error;
    const bool replayed = std::filesystem::exists(options.run / "metrics.json", error);
    if (arguments.out.empty() && !replayed) return usage("solve on a run of the daemon needs --out DIR");
    return solve_run(options, arguments.out.empty() ? options.run : std::filesystem::path(arguments.out));
  }
  AddOptions add;
  add.a = arguments.pair[0];
  add.b = arguments.pair[1];
  add.in_map = arguments.frame == "map";
  add.snap = !arguments.no_snap;
  add.force = arguments.force;
  for (const std::string& text : arguments.points) {
    const std::optional<SpotPair> spots = parse_spots(text);
    if (!spots) return usage(fmt::format("--point {}: not AX,AY=BX,BY in metres", text));
    add.spots.push_back(*spots);
  }
  return add_tie(options, add);
}

int run_landmarks(const LandmarksArguments& arguments) {
  LandmarksOptions options;
  options.run = arguments.run;
  options.loops = !arguments.no_loops;
  if (!arguments.config.empty()) {
    Expected<Configuration> configuration = load_configuration(arguments.config);
    if (!configuration) return report("landmarks", configuration.error());
    options.configuration = *configuration;
  }
  const bool terminal = isatty(STDERR_FILENO) == 1;
  if (terminal) {
    options.progress = [](std::uint32_t done, std::uint32_t all) {
      fmt::print(stderr, "\r\033[Ksolving: sub-map {} of {}", done, all);
    };
  }
  const Expected<LandmarksAnswer> answer = ask(arguments, options);
  if (terminal) fmt::print(stderr, "\r\033[K");
  if (!answer) return report("landmarks", answer.error());
  fmt::print("{}", answer->text);
  return answer->done ? 0 : kFailed;
}

}  // namespace

void register_landmarks(CLI::App& app, CommandRun& run) {
  auto arguments = std::make_shared<LandmarksArguments>();
  CLI::App* command = app.add_subcommand("landmarks", "Manual optimisation: tie sub-maps of a finished run by hand");
  command
      ->add_option("VERB", arguments->verb, "list suspects, add a tie, remove or forbid one, undo the last edit, solve")
      ->required()
      ->check(CLI::IsMember({"list", "add", "remove", "forbid", "undo", "solve"}));
  command->add_option("RUN", arguments->run, "Folder of a run, or what replay --out made")->required();
  command->add_option("A_B", arguments->pair, "Numbers of two sub-maps (add, remove, forbid)")->expected(0, 2);
  command->add_option("--point", arguments->points, "AX,AY=BX,BY: a spot as sub-map A and as sub-map B show it, m")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command
      ->add_option("--frame", arguments->frame, "Points are of the map as solved now, or of each sub-map's own frame")
      ->check(CLI::IsMember({"map", "submap"}))
      ->capture_default_str();
  command->add_flag("--no-snap", arguments->no_snap, "Commit the points as they are (10 cm), without matching");
  command->add_flag("--force", arguments->force, "Commit even if other ties break");
  command->add_flag("--no-loops", arguments->no_loops, "Tie adjacent sub-maps, and those tied by hand, only");
  command->add_option("--out", arguments->out, "solve: folder for the map (default RUN if replay made it)");
  command->add_option("--config", arguments->config, "Configuration file (TOML)");
  command->callback([arguments, &run] { run = [arguments] { return run_landmarks(*arguments); }; });
}

}  // namespace submapd::tools
