#include "daemon/daemon.hpp"

#include <fmt/format.h>
#include <pthread.h>

#include <csignal>
#include <exception>

#include "daemon/control.hpp"
#include "daemon/daemon_log.hpp"
#include "daemon/live_run.hpp"
#include "daemon/realtime.hpp"
#include "daemon/version.hpp"

namespace submapd {

int run_daemon(const Configuration& configuration) {
  const sigset_t signals = ending_signals();
  ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  name_thread("submapd");
  log(Severity::kInfo, fmt::format("submapd {} starts", kVersion));
  if (Status status = lock_memory(); !status.ok()) log(Severity::kWarning, status.message());
  Expected<std::unique_ptr<LiveRun>> run = LiveRun::start(configuration);
  if (!run) {
    log(Severity::kError, run.error().message());
    return 1;
  }
  for (const std::string& remark : (*run)->remarks()) log(Severity::kWarning, remark);
  int code = 1;
  try {
    Control control(configuration, **run);
    code = control.serve();
  } catch (const std::exception& error) {  // no descriptors left, or no socket
    log(Severity::kError, error.what());
  }
  run->reset();
  log(Severity::kInfo, "ended");
  return code;
}

}  // namespace submapd
