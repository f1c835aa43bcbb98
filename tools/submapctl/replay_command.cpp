// submapctl replay: a recorded log to an optimised map.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <string>

#include "tools/replay/replay.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

struct ReplayArguments {
  std::string log;
  std::string out;
  std::string config;
  std::string odometry = "auto";
  std::string filter;
  int particles = 0;
  int threads = 1;
  int workers = 0;
  std::int64_t seed = -1;
  bool no_loops = false;
};

int run_replay(const ReplayArguments& arguments) {
  ReplayOptions options;
  if (!arguments.config.empty()) {
    Expected<Configuration> configuration = load_configuration(arguments.config);
    if (!configuration) return report("replay", configuration.error());
    options.configuration = *configuration;
  }
  MapperOptions& mapper = options.configuration.mapper;
  if (arguments.odometry == "use") mapper.odometry = OdometryUse::kUse;
  if (arguments.odometry == "ignore") mapper.odometry = OdometryUse::kIgnore;
  if (arguments.filter == "adaptive") mapper.filter = FilterMode::kAdaptive;
  if (arguments.filter == "rbpf") mapper.filter = FilterMode::kRbpf;
  if (arguments.filter == "fastslam") mapper.filter = FilterMode::kFastSlam;
  if (arguments.particles > 0) mapper.particles = arguments.particles;
  if (arguments.seed >= 0) mapper.seed = static_cast<std::uint64_t>(arguments.seed);
  options.log = arguments.log;
  options.out = arguments.out;
  options.threads = arguments.threads;
  options.workers = arguments.workers;
  options.loops = !arguments.no_loops;

  const bool progress = isatty(STDERR_FILENO) == 1;
  fmt::print(stderr, "replaying {} with seed {}\n", arguments.log, mapper.seed);
  const Expected<ReplayResult> result = replay(options, [progress](const ReplayProgress& p) {
    if (!progress) return;
    fmt::print(stderr, "\r\033[K{} {:3.0f} %  {} scans, {} sub-maps, {} loops", p.stage, 100.0 * p.share, p.scans,
               p.submaps, p.loops);
  });
  if (progress) fmt::print(stderr, "\n");
  if (!result) return report("replay", result.error());
  fmt::print("{}", result->summary);
  return 0;
}

}  // namespace

void register_replay(CLI::App& app, CommandRun& run) {
  auto arguments = std::make_shared<ReplayArguments>();
  CLI::App* command = app.add_subcommand("replay", "Map a recorded log: sub-maps, loops, final map");
  command->add_option("LOG", arguments->log, "CARMEN text log (plain, .gz, .xz) or .lcmlog")->required();
  command->add_option("--out", arguments->out, "Folder for the results; made if missing")->required();
  command->add_option("--config", arguments->config, "Configuration file (TOML)");
  command->add_option("--odometry", arguments->odometry, "auto: if it is there, moves and agrees with the scans")
      ->check(CLI::IsMember({"auto", "use", "ignore"}))
      ->capture_default_str();
  command->add_option("--filter", arguments->filter, "Particle filter (default adaptive)")
      ->check(CLI::IsMember({"adaptive", "rbpf", "fastslam"}));
  command->add_option("--particles", arguments->particles, "Particles of rbpf and fastslam (default 30)")
      ->check(CLI::Range(1, 500));
  command->add_option("--threads", arguments->threads, "Threads of the particle filter; same result for any number")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command
      ->add_option("--workers", arguments->workers,
                   "Map chunks of the log by so many at once, each with the memory of one mapper; same result for any "
                   "number, another than without")
      ->check(CLI::Range(1, 64));
  command->add_option("--seed", arguments->seed, "Seed of all random numbers (default 1)")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--no-loops", arguments->no_loops, "Tie adjacent sub-maps only");
  command->callback([arguments, &run] { run = [arguments] { return run_replay(*arguments); }; });
}

}  // namespace submapd::tools
