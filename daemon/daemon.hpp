// The program: runs, one after the other, until SIGTERM, seen by systemd and the operator.
#pragma once

#include <string>

#include "daemon/configuration.hpp"

namespace submapd {

struct StartOptions {
  std::string configuration;  // its file, read again upon SIGHUP
  std::string input;          // usb, lcm or the path of a log
};

// Runs until SIGTERM or SIGINT and returns the exit code: 0 ended by a signal, 1 could not start or go on. Call from
// the main thread before any other is made: its threads inherit the blocked signals.
[[nodiscard]] int run_daemon(Configuration configuration, const StartOptions& options);

}  // namespace submapd
