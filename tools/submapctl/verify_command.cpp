// submapctl verify: whether a run, a map or a file is whole.
#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "tools/submapctl/commands.hpp"
#include "tools/verify/verify.hpp"

namespace submapd::tools {
namespace {

int run_verify(const std::string& path) {
  const Expected<VerifyReport> report = verify(path);
  if (!report) {
    fmt::print(stderr, "submapctl verify: {}\n", report.error().message());
    return report.error().code() == StatusCode::kIo ? 1 : 2;
  }
  for (const std::string& problem : report->problems) fmt::print(stderr, "damaged: {}\n", problem);
  for (const std::string& remark : report->remarks) fmt::print("remark: {}\n", remark);
  fmt::print("{}: {}, {} files looked at, {} problems\n", path, report->what, report->files, report->problems.size());
  return report->problems.empty() ? 0 : 1;
}

}  // namespace

void register_verify(CLI::App& app, CommandRun& run) {
  auto path = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("verify", "Check every file of a run, a saved map, a log; 0 if all are whole");
  command->add_option("PATH", *path, "Folder of a run or a map; a log, journal, sub-map or file of poses")->required();
  command->callback([path, &run] { run = [path] { return run_verify(*path); }; });
}

}  // namespace submapd::tools
