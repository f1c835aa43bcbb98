// The program: runs, one after the other, until SIGTERM, seen by systemd and the operator.
#pragma once

#include <string>

#include "daemon/configuration.hpp"

namespace submapd {

// `path`: of the configuration file, read again upon SIGHUP. Runs until SIGTERM or SIGINT and returns the exit code: 0
// ended by a signal, 1 could not start or go on. Call from the main thread before any other is made: its threads
// inherit the blocked signals.
[[nodiscard]] int run_daemon(Configuration configuration, const std::string& path);

}  // namespace submapd
