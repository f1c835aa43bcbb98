#include "daemon/command_hook.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "daemon/daemon_log.hpp"
#include "daemon/realtime.hpp"

namespace submapd {
namespace {

constexpr std::size_t kMostWaiting = 8;

// In a process group of its own, with no signal blocked or ignored. Gives the error of posix_spawn(3).
int spawn(const std::string& command, std::array<char*, 6>& environment, pid_t& child) {
  posix_spawnattr_t attributes;
  posix_spawn_file_actions_t actions;
  posix_spawnattr_init(&attributes);
  posix_spawn_file_actions_init(&actions);
  sigset_t none;
  sigset_t all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  std::string name = command;
  std::array<char*, 2> words = {name.data(), nullptr};
  const int error = ::posix_spawn(&child, command.c_str(), &actions, &attributes, words.data(), environment.data());
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  return error;
}

}  // namespace

CommandHook::CommandHook(const HookConfiguration& configuration)
    : stop_fd_(::eventfd(0, EFD_CLOEXEC)), configuration_(configuration) {
  if (stop_fd_ < 0) throw std::system_error(errno, std::generic_category(), "eventfd");
  thread_ = std::thread([this] { this->run(); });
}

CommandHook::~CommandHook() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  (void)::eventfd_write(stop_fd_, 1);
  changed_.notify_all();
  thread_.join();
  ::close(stop_fd_);
}

void CommandHook::tell(HookEvent event) {
  const MutexLock lock(mutex_);
  if (configuration_.command.empty()) return;
  if (events_.size() >= kMostWaiting) {
    ++failed_;
    return;
  }
  events_.push_back(std::move(event));
  changed_.notify_all();
}

void CommandHook::configure(const HookConfiguration& configuration) {
  const MutexLock lock(mutex_);
  configuration_ = configuration;
}

std::uint64_t CommandHook::failed() const {
  const MutexLock lock(mutex_);
  return failed_;
}

void CommandHook::run() {
  name_thread("hook");
  for (;;) {
    HookEvent event;
    HookConfiguration configuration;
    {
      const MutexLock lock(mutex_);
      while (events_.empty() && !stop_) changed_.wait(mutex_);
      if (stop_) return;
      event = std::move(events_.front());
      events_.pop_front();
      configuration = configuration_;
    }
    const std::string trouble = run_one(configuration, event);
    if (trouble.empty()) continue;
    log(Severity::kWarning, fmt::format("hook {} for {}: {}", configuration.command, event.event, trouble));
    const MutexLock lock(mutex_);
    ++failed_;
  }
}

std::string CommandHook::run_one(const HookConfiguration& configuration, const HookEvent& event) const {
  std::string words[] = {"PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "LANG=C.UTF-8",
                         "SUBMAPD_EVENT=" + event.event, "SUBMAPD_MAP=" + event.map,
                         "SUBMAPD_MESSAGE=" + event.message};
  std::array<char*, 6> environment{};
  for (std::size_t i = 0; i < std::size(words); ++i) environment[i] = words[i].data();
  pid_t child = 0;
  if (const int error = spawn(configuration.command, environment, child); error != 0) {
    return fmt::format("cannot run it: {}", std::strerror(error));
  }
  const int child_fd = static_cast<int>(::syscall(SYS_pidfd_open, child, 0));
  std::array<pollfd, 2> fds{{{child_fd, POLLIN, 0}, {stop_fd_, POLLIN, 0}}};
  const int woken = ::poll(fds.data(), fds.size(), 1000 * configuration.longest_s);
  const bool ended = woken > 0 && (fds[0].revents & POLLIN) != 0;
  // Also when the program has ended: the children it left are of its group. Until waitpid() nobody else gets its
  // number.
  ::kill(-child, SIGKILL);
  if (child_fd >= 0) ::close(child_fd);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!ended) return woken == 0 ? fmt::format("killed after {} s", configuration.longest_s) : "killed: submapd ends";
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  return WIFEXITED(status) ? fmt::format("exit code {}", WEXITSTATUS(status))
                           : fmt::format("ended by signal {}", WTERMSIG(status));
}

}  // namespace submapd
