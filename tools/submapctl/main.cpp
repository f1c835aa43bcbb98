// submapctl: the command line to submapd, its logs and its maps.
#include <cstdio>
#include <exception>

#include "daemon/allocator.hpp"
#include "tools/submapctl/commands.hpp"

int main(int argc, char** argv) {
  submapd::set_up_allocator();
  try {
    CLI::App app("Control submapd, replay its logs, simulate worlds for it", "submapctl");
    app.require_subcommand(1);
    submapd::tools::CommandRun run;
    submapd::tools::register_control(app, run);
    submapd::tools::register_landmarks(app, run);
    submapd::tools::register_replay(app, run);
    submapd::tools::register_scip_decode(app, run);
    submapd::tools::register_sensors(app, run);
    submapd::tools::register_simulate(app, run);
    submapd::tools::register_verify(app, run);
    try {
      app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
      return app.exit(error) == 0 ? 0 : 2;
    }
    return run();
  } catch (const std::exception& error) {
    // Only libraries throw, e.g. out of memory.
    std::fprintf(stderr, "submapctl: %s\n", error.what());
    return 1;
  }
}
