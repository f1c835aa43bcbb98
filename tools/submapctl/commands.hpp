// The sub-commands of submapctl. Each registers its options and, when it is the one asked for, sets `run`.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace submapd::tools {

using CommandRun = std::function<int()>;  // returns the exit code: 0 done, 1 failed, 2 bad input, 75 try again later

void register_control(CLI::App& app, CommandRun& run);  // what is asked of a running daemon
void register_replay(CLI::App& app, CommandRun& run);
void register_scip_decode(CLI::App& app, CommandRun& run);
void register_sensors(CLI::App& app, CommandRun& run);
void register_simulate(CLI::App& app, CommandRun& run);
void register_verify(CLI::App& app, CommandRun& run);

}  // namespace submapd::tools
