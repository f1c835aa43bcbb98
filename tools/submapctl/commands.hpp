// The sub-commands of submapctl. Each registers its options and, when it is the one asked for, sets `run`.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string_view>

#include "slam/base/status.hpp"

namespace submapd::tools {

constexpr int kFailed = 1;
constexpr int kBadInput = 2;
constexpr int kLater = 75;                // try again later
using CommandRun = std::function<int()>;  // returns the exit code: 0 or one of these

// Tells on stderr what went wrong with `command`. Returns the exit code for it.
int report(std::string_view command, const Status& status);

void register_control(CLI::App& app, CommandRun& run);  // what is asked of a running daemon
void register_landmarks(CLI::App& app, CommandRun& run);
void register_replay(CLI::App& app, CommandRun& run);
void register_scip_decode(CLI::App& app, CommandRun& run);
void register_sensors(CLI::App& app, CommandRun& run);
void register_simulate(CLI::App& app, CommandRun& run);
void register_verify(CLI::App& app, CommandRun& run);

}  // namespace submapd::tools
