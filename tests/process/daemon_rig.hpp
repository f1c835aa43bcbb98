// The real submapd as a child process, facing two emulated scanners on a cart that rolls through the simulated office.
//
// Real time, hence SCHED_FIFO where it is allowed: the scanners must not be late because a build runs beside them.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "daemon/run_clock.hpp"
#include "daemon/run_journal.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/control/control_client.hpp"
#include "tools/hokuyo_sim/umockdev_front.hpp"
#include "tools/hokuyo_sim/world_ranges.hpp"
#include "tools/sim/office.hpp"

extern char** environ;  // NOLINT(readability-redundant-declaration): POSIX wants it declared by the program

namespace submapd::test {

using nlohmann::json;

constexpr const char* kSerials[] = {"00903971", "00900001"};

[[nodiscard]] inline std::vector<std::byte> bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

// In systemd's place: what the daemon notifies.
class NotifySocket {
 public:
  explicit NotifySocket(const std::string& path) : fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) take();
      take();
    });
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  ~NotifySocket() {
    if (thread_.joinable()) (void)heard();
    ::close(fd_);
  }
  // Ends listening.
  [[nodiscard]] std::vector<std::string> heard() {
    thread_.request_stop();
    thread_.join();
    return heard_;
  }

 private:
  void take() {
    pollfd poll_fd{fd_, POLLIN, 0};
    int timeout_ms = 50;
    while (::poll(&poll_fd, 1, timeout_ms) > 0) {
      std::array<char, 4096> text{};
      const ssize_t size = ::recv(fd_, text.data(), text.size(), 0);
      if (size > 0) heard_.emplace_back(text.data(), static_cast<std::size_t>(size));
      timeout_ms = 0;
    }
  }
  int fd_;
  std::vector<std::string> heard_;  // the thread's while it runs
  std::jthread thread_;
};

class DaemonRig {
 public:
  DaemonRig() : notify(scratch() / "notify") {
    ::setenv("NOTIFY_SOCKET", (scratch() / "notify").c_str(), 1);
    ::setenv("WATCHDOG_USEC", "1000000", 1);
    sched_param fifo{};
    fifo.sched_priority = 50;
    if (::sched_setscheduler(0, SCHED_FIFO, &fifo) != 0) std::fprintf(stderr, "no SCHED_FIFO: scans may be late\n");
    std::ofstream(config()) << "[scanner]\nhorizontal = \"" << kSerials[0] << "\"\nvertical = \"" << kSerials[1]
                            << "\"\nvertical_z = 1.2\n[daemon]\nstate = \"" << state().string()
                            << "\"\ncontrol_socket = \"" << socket() << "\"\n[submap]\npath = 3.0\n";
    tools::MotionOptions options;
    options.speed_m_s = 1.5;
    options.duration_s = 600.0;
    motion_ = std::make_shared<const tools::Motion>(*tools::Motion::along(tools::office_tour(), options));
    plug_scanners();
  }
  DaemonRig(const DaemonRig&) = delete;
  DaemonRig& operator=(const DaemonRig&) = delete;
  ~DaemonRig() {
    if (child_ > 0) (void)end(SIGKILL);
    if (testing::Test::HasFailure()) std::fprintf(stderr, "submapd said:\n%s", messages().c_str());
  }

  // Two scanners that have their power, on a cart that stands for as long as the daemon needs to know their clocks,
  // then rolls. Also after a daemon was killed: the emulation does not stand a client that vanishes. REQUIRES: no
  // daemon runs.
  void plug_scanners() {
    const auto world = std::make_shared<const tools::World>(tools::office_world());
    front.reset();
    front = std::make_unique<tools::UmockdevFront>();
    start_ns_ = driver::monotonic_now_ns() + kStands_ns;
    for (std::size_t i = 0; i < 2; ++i) {
      tools::EmulatedScanner scanner;
      scanner.port = i == 0 ? "1-1" : "1-2";
      scanner.sensor.serial = kSerials[i];
      scanner.sensor.boot_ns = 0;
      scanner.sensor.seed = i + 1;
      scanner.ranges = [this, world, i] {
        tools::WorldRangesOptions ranges;
        ranges.seed = i + 1;
        ranges.vertical = i == 1;
        ranges.start_ns = start_ns_;
        return std::make_unique<tools::WorldRanges>(world, motion_, ranges);
      };
      scanner.truth = [this, i](const driver::SimScanTruth& scan) {
        if (scan.sent) last_sent_ns_[i].store(scan.sent_ns);
      };
      front->plug(std::move(scanner));
    }
  }

  void start() {
    const std::vector<std::string> words = {SUBMAPD, "--foreground", "--config", config()};
    child_ = spawn(words, (folder_.path() / "messages").string());
    ASSERT_GT(child_, 0);
  }
  void signal(int which) { ::kill(child_, which); }
  // Sends the signal and returns the exit code, or minus the signal that ended it.
  int end(int signal) {
    ::kill(child_, signal);
    return wait_for(std::exchange(child_, 0));
  }
  // Runs a program to its end.
  int run(const std::vector<std::string>& words) { return wait_for(spawn(words, (folder_.path() / "other").string())); }

  [[nodiscard]] json ask(const json& request) {
    Expected<tools::ControlClient> client = tools::ControlClient::connect(socket());
    if (!client) return json::object();
    Expected<json> reply = client->ask(request);
    return reply ? *reply : json::object();
  }
  [[nodiscard]] json health() { return ask({{"verb", "health"}}).value("health", json::object()); }
  // True as soon as the daemon's health fulfils the condition.
  [[nodiscard]] bool wait_for_health(const std::function<bool(const json&)>& condition, int seconds = 20) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
    while (std::chrono::steady_clock::now() < until) {
      const json now = health();
      if (!now.empty() && condition(now)) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the daemon tells only who asks
    }
    return false;
  }
  [[nodiscard]] bool wait_for_submaps(int count) {
    return wait_for_health([count](const json& h) { return h["recorder"]["last_submap"] >= count - 1; });
  }

  // Folders of runs, oldest first.
  [[nodiscard]] std::vector<std::filesystem::path> runs() const {
    std::vector<std::filesystem::path> all;
    for (const auto& entry : std::filesystem::directory_iterator(state() / "runs")) all.push_back(entry.path());
    std::sort(all.begin(), all.end());
    return all;
  }
  [[nodiscard]] static JournalContents journal_of(const std::filesystem::path& run) {
    Expected<JournalContents> contents = decode_journal(bytes_of(run / "journal"));
    EXPECT_TRUE(contents.has_value()) << contents.error().message();
    return contents ? *contents : JournalContents{};
  }
  // Where the cart was.
  [[nodiscard]] Pose2 truth(std::int64_t mono_ns) const {
    return motion_->at(static_cast<double>(mono_ns - start_ns_) * 1e-9);
  }
  [[nodiscard]] std::int64_t last_sent_ns(std::size_t scanner) const { return last_sent_ns_[scanner].load(); }
  [[nodiscard]] std::string messages() const {
    std::ifstream file(folder_.path() / "messages");
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  }

  [[nodiscard]] std::string config() const { return (folder_.path() / "cart.toml").string(); }
  [[nodiscard]] std::string socket() const { return (folder_.path() / "control").string(); }
  [[nodiscard]] std::filesystem::path state() const { return folder_.path() / "state"; }
  [[nodiscard]] const std::filesystem::path& scratch() const { return folder_.path(); }

  std::unique_ptr<tools::UmockdevFront> front;

 private:
  TemporaryFolder folder_;

 public:
  NotifySocket notify;

 private:
  static constexpr std::int64_t kStands_ns = 4'000'000'000;

  static pid_t spawn(const std::vector<std::string>& words, const std::string& output) {
    std::vector<char*> argv;
    for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, output.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    pid_t child = 0;
    const int error = ::posix_spawn(&child, argv[0], &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    return error == 0 ? child : -1;
  }
  static int wait_for(pid_t child) {
    int status = 0;
    if (child <= 0 || ::waitpid(child, &status, 0) != child) return -1000;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

  std::shared_ptr<const tools::Motion> motion_;
  std::int64_t start_ns_ = 0;
  std::array<std::atomic<std::int64_t>, 2> last_sent_ns_{};
  pid_t child_ = 0;
};

}  // namespace submapd::test
