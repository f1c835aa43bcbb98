#include "daemon/daemon.hpp"

#include <fmt/format.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <csignal>
#include <exception>
#include <optional>
#include <string>

#include "daemon/daemon_log.hpp"
#include "daemon/event_loop.hpp"
#include "daemon/live_run.hpp"
#include "daemon/realtime.hpp"
#include "daemon/service_manager.hpp"
#include "daemon/version.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kLook_ns = kSecond_ns / 10;

// A descriptor of the event loop, closed with the object.
class LoopDescriptor {
 public:
  LoopDescriptor(EventLoop& loop, int fd, EventLoop::Callback callback) : loop_(loop), fd_(fd) {
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), "control thread");
    if (Status status = loop_.add(fd_, EPOLLIN, std::move(callback)); !status.ok()) {
      throw std::runtime_error(status.message());
    }
  }
  LoopDescriptor(const LoopDescriptor&) = delete;
  LoopDescriptor& operator=(const LoopDescriptor&) = delete;
  ~LoopDescriptor() {
    loop_.remove(fd_);
    ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }

 private:
  EventLoop& loop_;
  const int fd_;
};

sigset_t ending_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  return signals;
}

// What the control thread does while a run lasts: looks, tells, feeds the watchdog, waits for the end.
class Control {
 public:
  explicit Control(LiveRun& run)
      : run_(run),
        signals_(loop_, open_signals(), [this](std::uint32_t) { on_signal(); }),
        timer_(loop_, open_timer(), [this](std::uint32_t) { on_timer(); }) {}

  int serve() {
    service_.ready();
    const Status status = loop_.run();
    service_.stopping();
    if (status.ok()) return 0;
    log(Severity::kError, status.message());
    return 1;
  }

 private:
  static int open_signals() {
    const sigset_t signals = ending_signals();
    return ::signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
  }
  static int open_timer() {
    const int fd = ::timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
    const itimerspec often{{0, kLook_ns}, {0, kLook_ns}};
    if (fd >= 0) ::timerfd_settime(fd, 0, &often, nullptr);
    return fd;
  }

  void on_signal() {
    signalfd_siginfo info{};
    if (::read(signals_.get(), &info, sizeof info) != sizeof info) return;
    log(Severity::kInfo, fmt::format("signal {}: the run ends", info.ssi_signo));
    loop_.stop();
  }

  void on_timer() {
    std::uint64_t expirations = 0;
    if (::read(timer_.get(), &expirations, sizeof expirations) != sizeof expirations) return;
    const std::int64_t now_ns = monotonic_ns();
    Health health = run_.look();
    const bool news = !last_ || differs(*last_, health);
    if (news || now_ns - published_ns_ >= kSecond_ns) {
      published_ns_ = now_ns;
      run_.publish(health);
      service_.status(words_of(health));
    }
    tell_trouble(health);
    last_ = std::move(health);
    if (service_.watchdog_ns() > 0 && now_ns - fed_ns_ >= service_.watchdog_ns() && run_.all_moved()) {
      fed_ns_ = now_ns;
      service_.feed_watchdog();
    }
  }

  // Each trouble once when it comes, and a word when all is well again.
  void tell_trouble(const Health& health) {
    const std::string trouble = trouble_of(health);
    if (trouble == told_) return;
    told_ = trouble;
    log(trouble.empty() ? Severity::kInfo : Severity::kWarning, trouble.empty() ? "all is well" : trouble);
  }

  LiveRun& run_;
  ServiceManager service_;
  EventLoop loop_;
  LoopDescriptor signals_;
  LoopDescriptor timer_;
  std::optional<Health> last_;
  std::int64_t published_ns_ = 0;
  std::int64_t fed_ns_ = 0;
  std::string told_;
};

}  // namespace

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
    code = Control(**run).serve();
  } catch (const std::exception& error) {  // no descriptors left
    log(Severity::kError, error.what());
  }
  run->reset();
  log(Severity::kInfo, "ended");
  return code;
}

}  // namespace submapd
