// submapd: the indoor mapping daemon.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>

#include "daemon/allocator.hpp"
#include "daemon/configuration.hpp"
#include "daemon/daemon.hpp"
#include "daemon/daemon_log.hpp"
#include "daemon/version.hpp"

namespace {

int start(int argc, char** argv) {
  CLI::App app("Maps while the cart rolls: two laser scanners in, sub-maps, loops and a finished map out", "submapd");
  app.set_version_flag("--version", submapd::kVersion);
  std::string config = "/etc/submapd/submapd.toml";
  std::string input = "usb";
  bool foreground = false;
  app.add_option("--config", config, "Configuration file (TOML)")->capture_default_str();
  app.add_option("--input", input, "Where scans come from: usb, lcm, or a recorded log")->capture_default_str();
  app.add_flag("--foreground", foreground, "Messages for a person at a terminal instead of the journal");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const submapd::Expected<submapd::Configuration> configuration = submapd::load_configuration(config);
  if (!configuration) {
    fmt::print(stderr, "submapd: {}\n", configuration.error().message());
    return 2;
  }
  submapd::open_log(foreground);
  return submapd::run_daemon(*configuration, {.configuration = config, .input = input});
}

}  // namespace

int main(int argc, char** argv) {
  submapd::set_up_allocator();
  try {
    return start(argc, argv);
  } catch (const std::exception& error) {  // only libraries throw, e.g. out of memory
    std::fprintf(stderr, "submapd: %s\n", error.what());
    return 1;
  }
}
