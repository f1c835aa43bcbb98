// hokuyo-sim: emulated UTM-30LX scanners on a simulated cart or with recorded ranges.
#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "driver/monotonic.hpp"
#include "proto/channels.hpp"
#include "proto/scan_conversion.hpp"
#include "tools/hokuyo_sim/pty_front.hpp"
#include "tools/hokuyo_sim/truth_log.hpp"
#include "tools/hokuyo_sim/umockdev_front.hpp"
#include "tools/hokuyo_sim/usbip_front.hpp"
#include "tools/hokuyo_sim/world_ranges.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/sim/scene.hpp"
#include "tools/sim/worlds/worlds.hpp"

extern char** environ;  // NOLINT(readability-redundant-declaration): POSIX wants it declared by the program

namespace submapd::tools {
namespace {

struct Arguments {
  std::string front = "umockdev";
  std::size_t scanners = 1;
  std::vector<std::string> serials;
  std::string world = "office";
  std::string log;
  std::size_t vertical = 2;
  double ceiling_m = 2.8;
  double speed_m_s = 1.0;
  double stand_s = 0.0;
  double halt_s = 0.0;
  double halt_for_s = 0.0;
  std::vector<std::string> faults;
  driver::SimSensorOptions sensor;
  double boot_s = 1.5;
  double usb_frame_us = 0.0;
  double stamp_offset_us = 0.0;
  std::string truth;
  std::uint16_t usbip_port = 3240;  // USB/IP's own
  std::vector<std::string> command;
};

int complain(const std::string& message, int code) {
  fmt::print(stderr, "hokuyo-sim: {}\n", message);
  return code;
}

// "N:KIND@S" for scanner N, 1 without a number.
Status add_fault(const std::string& text, std::vector<driver::SimSensorOptions>& sensors) {
  const bool numbered = text.size() > 2 && text[1] == ':' && text[0] >= '1' && text[0] <= '9';
  const std::size_t index = numbered ? static_cast<std::size_t>(text[0] - '1') : 0;
  if (index >= sensors.size()) {
    return {StatusCode::kInvalidArgument, fmt::format("--fault {}: there is no scanner {}", text, index + 1)};
  }
  const auto fault = driver::parse_sim_fault(numbered ? std::string_view(text).substr(2) : std::string_view(text));
  if (!fault) {
    return {StatusCode::kInvalidArgument, "--fault: " + fault.error()};
  }
  sensors[index].script.push_back(*fault);
  return {};
}

Expected<std::vector<driver::SimSensorOptions>> sensors_of(const Arguments& arguments) {
  std::vector<driver::SimSensorOptions> sensors(arguments.scanners, arguments.sensor);
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    sensors[i].serial = i < arguments.serials.size() ? arguments.serials[i] : fmt::format("{:08d}", 900001 + i);
    sensors[i].boot_ns = static_cast<std::int64_t>(1e9 * arguments.boot_s);
    sensors[i].usb_frame_ns = static_cast<std::int64_t>(1e3 * arguments.usb_frame_us);
    sensors[i].stamp_to_step0_ns = static_cast<std::int64_t>(1e3 * arguments.stamp_offset_us);
    sensors[i].seed += i;
    // Two crystals never agree, and neither do two rotors.
    sensors[i].clock_ppm *= i % 2 == 0 ? 1.0 : -1.0;
    sensors[i].grid_phase_ns = static_cast<std::int64_t>(i) * 7'000'000;
  }
  for (const std::string& fault : arguments.faults) {
    if (Status status = add_fault(fault, sensors); !status.ok()) {
      return failure(std::move(status));
    }
  }
  return sensors;
}

using MakeRanges = std::function<std::unique_ptr<driver::RangeSource>(std::size_t scanner)>;
struct Surroundings {
  MakeRanges ranges;
  TruthLog::PoseAt pose_at;  // empty: recorded
};

Expected<Surroundings> recorded_ranges(const std::string& path) {
  auto reader =
      open_log(path, [](std::string_view channel, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
        if (channel != Channels().scan_h) {
          return std::optional<Scan>{};
        }
        auto message = decode_scan(data);
        if (!message) {
          return tl::unexpected(message.error());
        }
        return std::optional<Scan>(std::move(message->scan));
      });
  if (!reader) {
    return failure(reader.error());
  }
  constexpr std::size_t kMost = 40 * 600;  // ten minutes, some 100 MB
  std::vector<std::vector<std::uint32_t>> scans;
  while (scans.size() < kMost) {
    auto scan = (*reader)->next();
    if (!scan) {
      return failure(scan.error());
    }
    if (!*scan) {
      break;
    }
    scans.emplace_back((*scan)->ranges_mm.begin(), (*scan)->ranges_mm.end());
  }
  if (scans.empty()) {
    return failure(StatusCode::kInvalidArgument, path + " holds no scans");
  }
  return Surroundings{[scans](std::size_t) { return std::make_unique<driver::RecordedRanges>(scans); }, {}};
}

Expected<Surroundings> simulated_ranges(const Arguments& arguments) {
  const auto scene = make_scene({arguments.world, "", 0.05, arguments.sensor.seed});
  if (!scene) {
    return failure(scene.error());
  }
  MotionOptions options;
  options.seed = arguments.sensor.seed;
  options.speed_m_s = arguments.speed_m_s;
  constexpr double kLongest_s = 24.0 * 3600.0;
  options.duration_s = scene->route.closed ? kLongest_s : 0.0;
  auto motion = Motion::along(scene->route, options);
  if (!motion) {
    return failure(motion.error());
  }
  const auto cart = std::make_shared<const Motion>(std::move(*motion));
  WorldRangesOptions ranges;
  ranges.ceiling_m = arguments.ceiling_m;
  ranges.start_ns = driver::monotonic_now_ns() + static_cast<std::int64_t>(1e9 * arguments.stand_s);
  ranges.halt_s = arguments.halt_s;
  ranges.halt_for_s = arguments.halt_for_s;
  const auto ranges_of = [=, world = scene->world, seed = arguments.sensor.seed,
                          vertical = arguments.vertical](std::size_t scanner) {
    WorldRangesOptions own = ranges;
    own.seed = seed + scanner;
    own.vertical = scanner + 1 == vertical;
    return std::make_unique<WorldRanges>(world, cart, own);
  };
  return Surroundings{
      ranges_of, [cart, ranges](std::int64_t mono_ns) { return pose_at(*cart, ranges, static_cast<double>(mono_ns)); }};
}

void wait_for_signal() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  int which = 0;
  sigwait(&signals, &which);
}

// Runs the command and gives its exit code.
int run_command(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  for (const std::string& word : command) {
    argv.push_back(const_cast<char*>(word.c_str()));
  }
  argv.push_back(nullptr);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  pid_t child = 0;
  const int error = posix_spawnp(&child, argv[0], nullptr, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  if (error != 0) {
    return complain(fmt::format("cannot run {}: {}", command[0], std::strerror(error)), 2);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

int serve_umockdev(const Arguments& arguments, const std::vector<driver::SimSensorOptions>& sensors,
                   const Surroundings& around, TruthLog& truth) {
  UmockdevFront front;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    EmulatedScanner scanner;
    scanner.port = fmt::format("1-{}", i + 1);
    scanner.sensor = sensors[i];
    scanner.ranges = [&around, i] { return around.ranges(i); };
    scanner.truth = truth.sink(i + 1, sensors[i].serial, around.pose_at);
    front.plug(std::move(scanner));
  }
  if (!arguments.command.empty()) {
    return run_command(arguments.command);
  }
  fmt::print("UMOCKDEV_DIR={}\n", front.root());
  std::fflush(stdout);
  wait_for_signal();
  return 0;
}

using Models = std::vector<std::unique_ptr<driver::SimSensor>>;

Models make_models(const std::vector<driver::SimSensorOptions>& sensors, const Surroundings& around, TruthLog& truth) {
  Models models;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    models.push_back(std::make_unique<driver::SimSensor>(sensors[i], around.ranges(i),
                                                         truth.sink(i + 1, sensors[i].serial, around.pose_at)));
  }
  return models;
}

int serve_usbip(std::uint16_t port, const Models& models) {
  std::vector<driver::SimSensor*> sensors;
  for (const auto& model : models) {
    sensors.push_back(model.get());
  }
  auto front = UsbipFront::open(port, sensors);
  if (!front) {
    return complain(front.error().message(), 1);
  }
  fmt::print("127.0.0.1:{}\n", (*front)->port());
  std::fflush(stdout);
  std::atomic<bool> stop{false};
  std::thread server([&front, &stop] { (*front)->run(stop); });
  wait_for_signal();
  stop = true;
  server.join();
  return 0;
}

int serve_pty(const std::vector<driver::SimSensorOptions>& sensors, const Models& models) {
  std::vector<PtyFront> fronts;
  for (std::size_t i = 0; i < sensors.size(); ++i) {
    auto front = PtyFront::open(*models[i]);
    if (!front) {
      return complain(front.error().message(), 1);
    }
    fmt::print("{} {}\n", sensors[i].serial, front->path());
    fronts.push_back(std::move(*front));
  }
  std::fflush(stdout);
  std::atomic<bool> stop{false};
  std::vector<std::thread> threads;
  for (PtyFront& front : fronts) {
    threads.emplace_back([&front, &stop] { front.run(stop); });
  }
  wait_for_signal();
  stop = true;
  for (std::thread& thread : threads) {
    thread.join();
  }
  return 0;
}

int serve(const Arguments& arguments) {
  const auto sensors = sensors_of(arguments);
  if (!sensors) {
    return complain(sensors.error().message(), 2);
  }
  const auto around = arguments.log.empty() ? simulated_ranges(arguments) : recorded_ranges(arguments.log);
  if (!around) {
    return complain(around.error().message(), 2);
  }
  auto truth = TruthLog::open(arguments.truth);
  if (!truth) {
    return complain(truth.error().message(), 1);
  }
  // Threads inherit the mask, so that only wait_for_signal() sees these.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  if (arguments.front == "umockdev") {
    return serve_umockdev(arguments, *sensors, *around, **truth);
  }
  const Models models = make_models(*sensors, *around, **truth);
  return arguments.front == "pty" ? serve_pty(*sensors, models) : serve_usbip(arguments.usbip_port, models);
}

void add_options(CLI::App& app, Arguments& a) {
  app.add_option(
         "--front", a.front,
         "umockdev: behind libusb, for COMMAND; pty: at pseudo-terminals; usbip: at a TCP port of this host, for "
         "a kernel with vhci-hcd (usbip attach -r 127.0.0.1 -b 1-1)")
      ->check(CLI::IsMember({"umockdev", "pty", "usbip"}))
      ->capture_default_str();
  app.add_option("--usbip-port", a.usbip_port, "Port of --front usbip; 0: any free one, which is printed")
      ->capture_default_str();
  app.add_option("--scanners", a.scanners, "How many, at ports 1-1, 1-2, ...")
      ->check(CLI::Range(1, 4))
      ->capture_default_str();
  app.add_option("--serial", a.serials, "Serial number of the first, the second, ...; else 00900001, 00900002, ...");
  app.add_option("--world", a.world, world_names() + ", or a file of walls .csv or a grey map .pgm, .pgm.gz")
      ->capture_default_str();
  app.add_option("--log", a.log, "Recorded ranges instead of a world: a log, over and over")->check(CLI::ExistingFile);
  app.add_option("--vertical", a.vertical, "Which scanner stands upright; 0: none")->capture_default_str();
  app.add_option("--ceiling", a.ceiling_m, "Height of the rooms in m, for the upright one")
      ->check(CLI::Range(1.5, 30.0))
      ->capture_default_str();
  app.add_option("--speed", a.speed_m_s, "Top speed of the cart in m/s")
      ->check(CLI::Range(0.05, 5.0))
      ->capture_default_str();
  app.add_option("--stand", a.stand_s, "Seconds that the cart stands before it rolls")
      ->check(CLI::Range(0.0, 600.0))
      ->capture_default_str();
  app.add_option("--halt", a.halt_s, "Seconds that the cart rolls before it stops at once, for --halt-for")
      ->check(CLI::Range(0.0, 86'400.0));
  app.add_option("--halt-for", a.halt_for_s, "Seconds of that stop")->check(CLI::Range(0.0, 86'400.0));
  app.add_option(
         "--fault", a.faults,
         "[N:]KIND@SECONDS[:ARGUMENT]: what goes wrong with scanner N that long after its first scan; a wrong KIND "
         "lists them all")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--fault-rate", a.sensor.fault_rate, "Share of scans with a random fault that can be detected")
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--damage-rate", a.sensor.damage_rate, "Share of scans with two bytes changed inside the alphabet")
      ->check(CLI::Range(0.0, 1.0));
  app.add_option("--seed", a.sensor.seed, "Of all noise and random faults")->capture_default_str();
  app.add_option("--boot", a.boot_s, "Seconds from power-on to the first answer")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  app.add_option("--clock-ppm", a.sensor.clock_ppm, "Error of the sensors' crystals; every second one has the opposite")
      ->check(CLI::Range(-1000.0, 1000.0));
  app.add_option("--clock-start-ms", a.sensor.clock_start_ms, "Of the 24-bit counter at power-on")
      ->check(CLI::Range(0, 0xFFFFFF));
  app.add_option("--usb-frame-us", a.usb_frame_us, "Bytes appear on this grid of the host's clock; 0: at once")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--stamp-offset-us", a.stamp_offset_us,
                 "The first beam comes this long after the instant of the stamp")
      ->check(CLI::Range(-25000.0, 25000.0));
  app.add_option("--truth", a.truth, "File for the truth of each scan, a JSON line each; - is the standard output");
  app.add_option("command", a.command,
                 "What to run with these scanners plugged in, e.g. submapctl sensors; without it "
                 "they stay until SIGINT or SIGTERM");
  app.positionals_at_end();
}

int start(int argc, char** argv) {
  CLI::App app("Emulated UTM-30LX scanners", "hokuyo-sim");
  app.prefix_command(false);
  Arguments arguments;
  add_options(app, arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (arguments.front == "umockdev" && !UmockdevFront::available()) {
    // umockdev's library must be there before the program starts.
    std::vector<char*> again = {const_cast<char*>("umockdev-wrapper")};
    again.insert(again.end(), argv, argv + argc + 1);
    execvp(again[0], again.data());
    return complain("cannot run umockdev-wrapper; install Debian's package umockdev, or use --front pty", 1);
  }
  return serve(arguments);
}

}  // namespace
}  // namespace submapd::tools

int main(int argc, char** argv) {
  try {
    return submapd::tools::start(argc, argv);
  } catch (const std::exception& error) {
    // Only libraries throw, e.g. umockdev's testbed on a full disk.
    return submapd::tools::complain(error.what(), 1);
  }
}
