// The control thread: signals, timer, watchdog, operator's requests, health. The main thread runs it.
//
// Looks at everything ten times a second, tells what changed, and answers the control socket. Never blocks: what takes
// longer is the saver's or the recorder's.
#pragma once

#include <csignal>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "daemon/command_hook.hpp"
#include "daemon/configuration.hpp"
#include "daemon/control_protocol.hpp"
#include "daemon/control_server.hpp"
#include "daemon/event_loop.hpp"
#include "daemon/lcm_requests.hpp"
#include "daemon/live_run.hpp"
#include "daemon/map_button.hpp"
#include "daemon/mark_list.hpp"
#include "daemon/service_manager.hpp"

namespace submapd {

// Those that the control thread takes. REQUIRES: blocked in all threads.
[[nodiscard]] sigset_t control_signals();

class Control {
 public:
  // Throws std::runtime_error where there is no socket or no descriptor: for start-up. SIGHUP
  // reads the file `path` again and puts what can change into `configuration`. References must outlive the object.
  Control(Configuration& configuration, std::string path, LiveRun& run, ServiceManager& service);
  Control(const Control&) = delete;
  Control& operator=(const Control&) = delete;
  ~Control();

  enum class End : std::uint8_t { kSignal, kNewRun, kError };
  // Until a signal or the operator ends the run.
  [[nodiscard]] End serve();

 private:
  void add(int fd, EventLoop::Callback callback);
  void on_signal();
  void on_hangup();
  void on_button();
  void on_input();
  void on_timer();
  [[nodiscard]] Health look();
  void tell(Health health, std::int64_t now_ns);
  void tell_trouble(const Health& health);
  void tell_waiting();

  std::string answer(std::string_view packet, const ControlPeer& peer);
  ControlReply answer_request(const ControlRequest& request, const ControlPeer& peer);
  ControlReply answer_health(const ControlRequest& request);
  ControlReply answer_save(const ControlRequest& request, const ControlPeer& peer);
  ControlReply answer_picture(const ControlRequest& request, const ControlPeer& peer);
  [[nodiscard]] Expected<SaveProgress> start_save(const ControlRequest& request);
  ControlReply answer_mark(const ControlRequest& request);
  ControlReply answer_command(const ControlRequest& request);

  Configuration& configuration_;
  const std::string path_;
  LiveRun& run_;
  End end_ = End::kError;
  ServiceManager& service_;
  EventLoop loop_;
  int signal_fd_ = -1;
  int timer_fd_ = -1;
  std::unique_ptr<ControlServer> server_;
  CommandHook hook_;
  std::unique_ptr<MapButton> button_;
  std::unique_ptr<LcmRequests> inputs_;  // if anything may come in

  std::optional<Health> last_;
  std::int64_t published_ns_ = 0;
  std::int64_t fed_ns_ = 0;
  std::int64_t looked_at_button_ns_ = 0;
  std::string told_;
  MarkList marks_;
  std::set<std::uint64_t> waiting_;            // clients that want to know how the save goes
  std::optional<LcmCommand> waiting_command_;  // over LCM: that began the save
  SaveProgress told_progress_;
};

}  // namespace submapd
