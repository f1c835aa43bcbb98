// submapctl status, health, monitor, save-map, get-map, mark, pause, resume, new-run: what is asked of a running
// daemon.
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "tools/control/control_client.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

using nlohmann::json;

constexpr std::chrono::minutes kLongestSave{15};

struct ControlArguments {
  std::string socket = "/run/submapd/control";
  bool json = false;
  bool once = false;
  bool wait = false;
  bool force = false;
  bool cloud = false;
  std::string name;
  std::int64_t utime_us = -1;
};

// Prints what failed and gives the exit code; 0 for a reply that did not fail.
int code_of(const char* command, const json& reply) {
  if (text_of(reply, "state") != "failed") return 0;
  fmt::print(stderr, "submapctl {}: {}\n", command, text_of(reply, "message"));
  const std::string reason = text_of(reply, "reason");
  return reason == "later" ? kLater : reason == "input" ? kBadInput : kFailed;
}

Expected<json> ask(const ControlArguments& arguments, const json& request) {
  Expected<ControlClient> client = ControlClient::connect(arguments.socket);
  if (!client) return failure(client.error());
  return client->ask(request);
}

int run_status(const ControlArguments& arguments) {
  const Expected<json> reply = ask(arguments, {{"verb", "status"}});
  if (!reply) return report("status", reply.error());
  if (const int code = code_of("status", *reply); code != 0) return code;
  fmt::print("{}\n", text_of(*reply, "message"));
  return 0;
}

// Healthy is exit code 0, degraded or failed 1.
int run_health(const ControlArguments& arguments) {
  const Expected<json> reply = ask(arguments, {{"verb", "health"}});
  if (!reply) return report("health", reply.error());
  if (const int code = code_of("health", *reply); code != 0) return code;
  const json health = reply->value("health", json::object());
  const std::string state = text_of(health, "state");
  fmt::print("{}\n", arguments.json ? health.dump(2) : text_of(*reply, "message"));
  return state == "degraded" || state == "failed" ? 1 : 0;
}

int run_monitor(const ControlArguments& arguments) {
  for (;;) {
    const Expected<json> reply = ask(arguments, {{"verb", "health"}});
    if (!reply) return report("monitor", reply.error());
    if (const int code = code_of("monitor", *reply); code != 0) return code;
    const json health = reply->value("health", json::object());
    if (arguments.json) {
      fmt::print("{}\n", health.dump());
    } else {
      fmt::print("{}{}", arguments.once ? "" : "\033[H\033[J", screen_of(health));
    }
    std::fflush(stdout);
    if (arguments.once) return 0;
    std::this_thread::sleep_for(std::chrono::seconds(1));
  }
}

int run_save_map(const ControlArguments& arguments) {
  Expected<ControlClient> client = ControlClient::connect(arguments.socket);
  if (!client) return report("save-map", client.error());
  std::random_device random;  // a process id would come again one day, and be taken for this request
  const json request = {{"verb", "save-map"},       {"id", fmt::format("{:08x}{:08x}", random(), random())},
                        {"name", arguments.name},   {"wait", arguments.wait},
                        {"cloud", arguments.cloud}, {"force", arguments.force}};
  Expected<json> reply = client->ask(request);
  const bool terminal = ::isatty(STDERR_FILENO) == 1;
  for (;;) {
    if (!reply) return report("save-map", reply.error());
    if (const int code = code_of("save-map", *reply); code != 0) return code;
    if (text_of(*reply, "state") == "done" || !arguments.wait) break;
    if (terminal) fmt::print(stderr, "\r\033[K{}", text_of(*reply, "message"));
    reply = client->receive(kLongestSave);
  }
  if (terminal && arguments.wait) fmt::print(stderr, "\r\033[K");
  const std::string path = text_of(*reply, "path");
  fmt::print("{}\n", path.empty() ? text_of(*reply, "message") : path);
  return 0;
}

// Copies an open file, from its start, to `path`.
Status copy_file(int file, const std::string& path) {
  AtomicFile out(path);
  std::vector<char> piece(1U << 16);
  for (off_t at = 0;;) {
    const ssize_t size = ::pread(file, piece.data(), piece.size(), at);
    if (size < 0) return {StatusCode::kIo, fmt::format("cannot read the picture: {}", std::strerror(errno))};
    if (size == 0) return out.commit();
    at += size;
    if (Status status = out.write({piece.data(), static_cast<std::size_t>(size)}); !status.ok()) return status;
  }
}

int run_get_map(const ControlArguments& arguments) {
  Expected<ControlClient> client = ControlClient::connect(arguments.socket);
  if (!client) return report("get-map", client.error());
  Expected<json> reply = client->ask({{"verb", "get-map"}});
  for (;;) {
    if (!reply) return report("get-map", reply.error());
    if (const int code = code_of("get-map", *reply); code != 0) return code;
    if (text_of(*reply, "state") == "done") break;
    reply = client->receive(kLongestSave);
  }
  const int file = client->take_file();
  if (file < 0) return report("get-map", {StatusCode::kInternal, "submapd sent no picture"});
  const Status status = copy_file(file, arguments.name);
  ::close(file);
  if (!status.ok()) return report("get-map", status);
  fmt::print("{}\n", arguments.name);
  return 0;
}

int run_mark(const ControlArguments& arguments) {
  json request = {{"verb", "mark"}, {"name", arguments.name}};
  if (arguments.utime_us >= 0) request["utime_us"] = arguments.utime_us;
  const Expected<json> reply = ask(arguments, request);
  if (!reply) return report("mark", reply.error());
  if (const int code = code_of("mark", *reply); code != 0) return code;
  fmt::print("{}\n", text_of(*reply, "message"));
  return 0;
}

int run_command(const char* verb, const ControlArguments& arguments) {
  const Expected<json> reply = ask(arguments, {{"verb", verb}});
  if (!reply) return report(verb, reply.error());
  if (const int code = code_of(verb, *reply); code != 0) return code;
  fmt::print("{}\n", text_of(*reply, "message"));
  return 0;
}
int run_pause(const ControlArguments& arguments) {
  return run_command("pause", arguments);
}
int run_resume(const ControlArguments& arguments) {
  return run_command("resume", arguments);
}
int run_new_run(const ControlArguments& arguments) {
  return run_command("new-run", arguments);
}

}  // namespace

void register_control(CLI::App& app, CommandRun& run) {
  const auto add = [&](const char* name, const char* help, int (*function)(const ControlArguments&)) {
    auto arguments = std::make_shared<ControlArguments>();
    CLI::App* command = app.add_subcommand(name, help);
    command->add_option("--socket", arguments->socket, "The daemon's control socket")->capture_default_str();
    command->callback([arguments, function, &run] { run = [arguments, function] { return function(*arguments); }; });
    return std::pair(command, arguments);
  };
  add("status", "One line: what the daemon does and what is wrong", run_status);

  auto [health, health_arguments] = add("health", "Exit code 0 if all is well, 1 if not", run_health);
  health->add_flag("--json", health_arguments->json, "The whole state as a JSON object");

  auto [monitor, monitor_arguments] = add("monitor", "The daemon's state on one screen, each second", run_monitor);
  monitor->add_flag("--once", monitor_arguments->once, "Once, then end");
  monitor->add_flag("--json", monitor_arguments->json, "A JSON object a line");

  auto [save, save_arguments] = add("save-map", "Save the map as it is now; mapping goes on", run_save_map);
  save->add_option("NAME", save_arguments->name, "Default map-YYYYmmdd-HHMMSS (UTC)");
  save->add_flag("--cloud", save_arguments->cloud, "With cloud.ply, from the vertical scanner's raw scans");
  save->add_flag("--wait", save_arguments->wait, "Until it is saved");
  save->add_flag("--force", save_arguments->force, "Replace a map of that name");

  auto [picture, picture_arguments] = add("get-map", "A picture of the map as it is known now", run_get_map);
  picture->add_option("OUT", picture_arguments->name, "PNG file")->required();

  add("pause", "Neither map nor record until resume; the map stays", run_pause);
  add("resume", "Go on after pause", run_resume);
  add("new-run", "End this run and begin the next, in a folder of its own", run_new_run);

  auto [mark, mark_arguments] = add("mark", "Name an instant; its pose comes into marks.csv of saved maps", run_mark);
  mark->add_option("NAME", mark_arguments->name, "Of the mark")->required();
  mark->add_option("--utime", mark_arguments->utime_us, "The instant in us, wall clock of the run; default now")
      ->check(CLI::NonNegativeNumber);
}

}  // namespace submapd::tools
