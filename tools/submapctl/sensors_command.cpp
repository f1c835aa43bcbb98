// submapctl sensors: what is plugged in, and which scanner is the horizontal and which the vertical one.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "daemon/configuration.hpp"
#include "tools/sensors/role_assignment.hpp"
#include "tools/sensors/sensor_survey.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

struct SensorsArguments {
  std::string config = "/etc/submapd/submapd.toml";
  bool json = false;
  std::vector<std::string> assign;
  std::string self_test;
  double wait_s = SurveyOptions{}.longest_s;
};

int assign(const SensorsArguments& arguments) {
  const auto roles = parse_assignment(arguments.assign);
  if (!roles) {
    return report("sensors", roles.error());
  }
  if (const Status status = assign_roles(arguments.config, *roles); !status.ok()) {
    return report("sensors", status);
  }
  fmt::print("{}: H is {}, V is {}. A running submapd takes it at its next start.\n", arguments.config,
             roles->horizontal, roles->vertical.value_or("nobody"));
  return 0;
}

// Of the self-test that was asked for.
int verdict(const std::vector<SurveyedSensor>& sensors, const std::string& serial) {
  const auto found = std::find_if(sensors.begin(), sensors.end(), [](const SurveyedSensor& sensor) {
    return sensor.info.status.self_test.has_value();
  });
  if (found == sensors.end()) {
    fmt::print(stderr, "submapctl sensors: --self-test {}: no such scanner answered in time\n", serial);
    return 1;
  }
  return found->info.status.self_test->passed() ? 0 : 1;
}

int list(const SensorsArguments& arguments) {
  SurveyOptions options;
  constexpr double kSelfTest_s = 7.0;  // a scanner that needs two turns a scan
  options.self_test = arguments.self_test;
  options.longest_s = arguments.wait_s + (arguments.self_test.empty() ? 0.0 : kSelfTest_s);
  const auto configuration = load_configuration(arguments.config);
  if (configuration) {
    options.roles = configuration->scanner.roles;
  } else if (configuration.error().code() != StatusCode::kNotFound) {
    return report("sensors", configuration.error());
  }
  const auto sensors = survey_sensors(options);
  if (!sensors) {
    return report("sensors", sensors.error());
  }
  if (arguments.json) {
    fmt::print("{}", json_of(*sensors));
  } else if (sensors->empty()) {
    fmt::print(stderr, "submapctl sensors: no scanner is plugged in (USB 15d1:0000 with a serial line)\n");
  } else {
    fmt::print("{}", table_of(*sensors));
  }
  return arguments.self_test.empty() ? 0 : verdict(*sensors, arguments.self_test);
}

}  // namespace

void register_sensors(CLI::App& app, CommandRun& run) {
  auto arguments = std::make_shared<SensorsArguments>();
  CLI::App* command =
      app.add_subcommand("sensors", "Scanners that are plugged in (not while submapd has them), and their roles");
  command->add_flag("--json", arguments->json, "A JSON array instead of a table");
  command
      ->add_option(
          "--assign", arguments->assign,
          "H=SERIAL V=SERIAL: writes into the configuration which scanner maps and which stands upright; V may "
          "be left out")
      ->expected(1, 2);
  command->add_option("--self-test", arguments->self_test,
                      "Tries whether the scanner with this serial number can send intensities at full rate, before you "
                      "set intensity = true; some firmware hangs, so keep its power switch at hand. Exit code 1: it "
                      "cannot");
  command->add_option("--config", arguments->config, "Configuration file")->capture_default_str();
  command->add_option("--wait", arguments->wait_s, "Longest time to wait for answers in s")
      ->check(CLI::Range(0.1, 120.0))
      ->capture_default_str();
  command->callback([arguments, &run] {
    run = [arguments] { return arguments->assign.empty() ? list(*arguments) : assign(*arguments); };
  });
}

}  // namespace submapd::tools
