// submapctl simulate: a world, a cart and a laser scanner; writes a log and its exact truth.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <memory>
#include <string>

#include "tools/sim/scan_sink.hpp"
#include "tools/sim/scene.hpp"
#include "tools/sim/simulator.hpp"
#include "tools/sim/worlds/worlds.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

struct SimulateArguments {
  std::string world;
  std::string out;
  std::string waypoints;
  double resolution_m = 0.05;
  std::uint64_t seed = 1;
  double minutes = 0.0;
  double speed_m_s = 1.5;
  int people = -1;  // as many as the world has
  int companions = 0;
  std::string effects;  // the world's own
  bool odometry = false;
  bool no_noise = false;
  std::string format = "clf";
};

Status write_run(Simulator& simulator, ScanSink& log, ScanSink& truth, std::uint64_t& written) {
  const bool progress = isatty(STDERR_FILENO) == 1;
  while (const std::optional<Scan> scan = simulator.next()) {
    const Pose2 pose = simulator.truth(*scan);
    for (ScanSink* sink : {&log, &truth}) {
      if (Status status = sink->write(*scan, pose); !status.ok()) {
        return status;
      }
    }
    ++written;
    if (progress && (scan->index % 400 == 0 || scan->index + 1 == simulator.scan_count())) {
      fmt::print(stderr, "\r{} of {} scans", scan->index + 1, simulator.scan_count());
    }
  }
  if (progress) {
    fmt::print(stderr, "\n");
  }
  if (Status status = log.finish(); !status.ok()) {
    return status;
  }
  return truth.finish();
}

int simulate(const SimulateArguments& arguments) {
  const Expected<Scene> scene =
      make_scene({arguments.world, arguments.waypoints, arguments.resolution_m, arguments.seed});
  if (!scene) {
    return report("simulate", scene.error());
  }

  MotionOptions motion_options;
  motion_options.seed = arguments.seed;
  motion_options.duration_s = 60.0 * arguments.minutes;
  motion_options.speed_m_s = arguments.speed_m_s;
  motion_options.cadence_ripple = scene->ripple;
  Effects effects = scene->effects;
  if (!arguments.effects.empty()) {
    const Expected<Effects> asked = parse_effects(arguments.effects);
    if (!asked) {
      return report("simulate", asked.error());
    }
    effects = *asked;
  }
  apply(effects, motion_options);
  Expected<Motion> motion = Motion::along(scene->route, motion_options);
  if (!motion) {
    return report("simulate", motion.error());
  }
  SimulatorOptions options;
  options.seed = arguments.seed;
  apply(effects, options.sensor);
  options.floor = scene->floor;
  options.later_world = effects.moved ? scene->moved : nullptr;
  options.sensor.noise = !arguments.no_noise;
  if (arguments.odometry) {
    options.odometry = OdometryOptions{};
  }
  const auto cart = std::make_shared<const Motion>(std::move(*motion));
  const auto crowd =
      std::make_shared<Crowd>(scene->walkways, arguments.people < 0 ? scene->people : arguments.people, arguments.seed);
  crowd->accompany(*cart, arguments.companions, arguments.seed);
  options.crowd = crowd;
  Simulator simulator(scene->world, cart, options);

  const std::string log_path = arguments.out + "." + arguments.format;
  auto log = arguments.format == "lcmlog" ? open_lcm_sink(log_path) : open_clf_sink(log_path);
  if (!log) {
    return report("simulate", log.error());
  }
  auto truth = open_truth_sink(arguments.out + ".truth.tum");
  if (!truth) {
    return report("simulate", truth.error());
  }
  std::uint64_t written = 0;
  if (const Status status = write_run(simulator, **log, **truth, written); !status.ok()) {
    return report("simulate", status);
  }
  fmt::print("{}.{}: {} scans, {:.1f} s, {:.1f} m of way, {} walls, {} people, seed {}\n", arguments.out,
             arguments.format, written, cart->duration_s(), cart->length_m(), scene->world->segments().size(),
             options.crowd->size(), arguments.seed);
  return 0;
}

}  // namespace

void register_simulate(CLI::App& app, CommandRun& run) {
  auto arguments = std::make_shared<SimulateArguments>();
  CLI::App* command = app.add_subcommand("simulate", "Write the log and the truth of a simulated run");
  command
      ->add_option("world", arguments->world, world_names() + ", or a file of walls .csv or a grey map .pgm, .pgm.gz")
      ->required();
  command->add_option("--out", arguments->out, "Prefix of the files written: PREFIX.clf and PREFIX.truth.tum")
      ->required();
  command->add_option("--resolution", arguments->resolution_m, "Metres a cell of a grey map")
      ->check(CLI::Range(0.001, 10.0))
      ->capture_default_str();
  command->add_option("--waypoints", arguments->waypoints,
                      "File of way-points, x,y a line; without it a tour is planned");
  command->add_option("--seed", arguments->seed, "Seed of all noise")->capture_default_str();
  command->add_option("--minutes", arguments->minutes, "Duration; the tour is repeated or cut; without it, one tour")
      ->check(CLI::Range(0.1, 1440.0));
  command->add_option("--people", arguments->people, "People who walk about; without it, as many as the world has")
      ->check(CLI::Range(0, 2000));
  command->add_option("--companions", arguments->companions, "People who go along with the cart")
      ->check(CLI::Range(0, 100));
  command->add_option("--effects", arguments->effects,
                      "Some of mixed,bias,clock,lost,jerky,moved, or all or none; without it, the world's own");
  command->add_option("--speed", arguments->speed_m_s, "Top speed in m/s")
      ->check(CLI::Range(0.05, 5.0))
      ->capture_default_str();
  command->add_flag("--odometry", arguments->odometry, "Write noisy wheel odometry into the log");
  command->add_flag("--no-noise", arguments->no_noise, "Exact ranges, none missing");
  command->add_option("--format", arguments->format, "Format of the log")
      ->check(CLI::IsMember({"clf", "clf.gz", "lcmlog"}))
      ->capture_default_str();
  command->callback([arguments, &run] { run = [arguments] { return simulate(*arguments); }; });
}

}  // namespace submapd::tools
