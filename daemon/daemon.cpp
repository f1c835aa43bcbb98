#include "daemon/daemon.hpp"

#include <fmt/format.h>
#include <pthread.h>

#include <csignal>
#include <exception>
#include <memory>
#include <string>

#include "daemon/control.hpp"
#include "daemon/daemon_log.hpp"
#include "daemon/live_run.hpp"
#include "daemon/realtime.hpp"
#include "daemon/service_manager.hpp"
#include "daemon/version.hpp"

namespace submapd {

namespace {

// One run, from its start to the last byte on the disk.
Control::End run_once(Configuration& configuration, const StartOptions& options, ServiceManager& service) {
  const Expected<std::unique_ptr<LiveRun>> run = LiveRun::start(configuration, options.input);
  if (!run) {
    log(Severity::kError, run.error().message());
    return Control::End::kError;
  }
  for (const std::string& remark : (*run)->remarks()) log(Severity::kWarning, remark);
  try {
    Control control(configuration, options.configuration, **run, service);
    service.ready();
    return control.serve();
  } catch (const std::exception& error) {  // no descriptors left, or no socket
    log(Severity::kError, error.what());
    return Control::End::kError;
  }
}

}  // namespace

int run_daemon(Configuration configuration, const StartOptions& options) {
  const sigset_t signals = control_signals();
  ::pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  ::signal(SIGPIPE, SIG_IGN);
  name_thread("submapd");
  log(Severity::kInfo, fmt::format("submapd {} starts", kVersion));
  if (Status status = lock_memory(); !status.ok()) log(Severity::kWarning, status.message());
  ServiceManager service;
  Control::End end = Control::End::kNewRun;
  while (end == Control::End::kNewRun) end = run_once(configuration, options, service);
  service.stopping();
  log(Severity::kInfo, "ended");
  return end == Control::End::kSignal ? 0 : 1;
}

}  // namespace submapd
