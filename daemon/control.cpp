#include "daemon/control.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/epoll.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <utility>

#include "daemon/daemon_log.hpp"
#include "driver/monotonic.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kLook_ns = kSecond_ns / 10;
constexpr std::int64_t kButtonLook_ns = 2 * kSecond_ns;

ControlReply reply_of(const std::string& id, const SaveProgress& progress) {
  if (progress.state == SaveState::kFailed) return refusal(id, progress.status);
  const bool done = progress.state == SaveState::kDone;
  nlohmann::json extra = {{"name", progress.name}, {"progress", progress.percent}};
  if (done) extra["path"] = progress.path;
  std::string words = done ? (progress.picture_only ? "drawn" : "saved " + progress.path)
                           : fmt::format("saving {}, {} %", progress.name, progress.percent);
  if (progress.cloud_bytes > 0) {
    extra["cloud_bytes"] = progress.cloud_bytes;
    words += fmt::format(", cloud of {:.1f} MB", 1e-6 * static_cast<double>(progress.cloud_bytes));
  }
  return {id, done ? ReplyState::kDone : ReplyState::kWorking, words, StatusCode::kOk, std::move(extra)};
}

}  // namespace

sigset_t control_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGHUP);
  return signals;
}

Control::Control(Configuration& configuration, std::string path, LiveRun& run, ServiceManager& service)
    : configuration_(configuration),
      path_(std::move(path)),
      run_(run),
      service_(service),
      hook_(configuration.hook),
      marks_(run.marks()) {
  const sigset_t signals = control_signals();
  signal_fd_ = ::signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
  timer_fd_ = ::timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
  const itimerspec often{{0, kLook_ns}, {0, kLook_ns}};
  if (timer_fd_ >= 0) ::timerfd_settime(timer_fd_, 0, &often, nullptr);
  add(signal_fd_, [this](std::uint32_t) { on_signal(); });
  add(timer_fd_, [this](std::uint32_t) { on_timer(); });

  ControlServerOptions options;
  options.path = configuration.daemon.control_socket;
  options.group = configuration.daemon.control_group;
  Expected<std::unique_ptr<ControlServer>> server = ControlServer::open(
      loop_, options, [this](std::string_view packet, const ControlPeer& peer) { return answer(packet, peer); });
  if (!server) throw std::runtime_error(server.error().message());
  server_ = std::move(*server);
  button_ = std::make_unique<MapButton>(loop_, configuration.button, [this] { on_button(); });
  if (configuration.lcm.triggers || configuration.lcm.commands) {
    inputs_ = std::make_unique<LcmRequests>(configuration.lcm);
    add(inputs_->fd(), [this](std::uint32_t) { on_input(); });
  }
}

Control::~Control() {
  server_.reset();
  button_.reset();
  if (inputs_ != nullptr) loop_.remove(inputs_->fd());
  for (const int fd : {signal_fd_, timer_fd_}) {
    if (fd < 0) continue;
    loop_.remove(fd);
    ::close(fd);
  }
}

void Control::add(int fd, EventLoop::Callback callback) {
  if (fd < 0) throw std::runtime_error(fmt::format("control thread: {}", std::strerror(errno)));
  if (Status status = loop_.add(fd, EPOLLIN, std::move(callback)); !status.ok()) {
    throw std::runtime_error(status.message());
  }
}

Control::End Control::serve() {
  const Status status = loop_.run();
  if (status.ok()) return end_;
  log(Severity::kError, status.message());
  return End::kError;
}

void Control::on_signal() {
  signalfd_siginfo info{};
  if (::read(signal_fd_, &info, sizeof info) != sizeof info) return;
  if (info.ssi_signo == SIGHUP) {
    on_hangup();
    return;
  }
  log(Severity::kInfo, fmt::format("signal {}: the run ends", info.ssi_signo));
  end_ = End::kSignal;
  loop_.stop();
}

// Pools, rings and sockets are made once, and a run's options are part of what replay repeats: they stay.
void Control::on_hangup() {
  const Expected<Configuration> read = load_configuration(path_);
  if (!read) {
    log(Severity::kError, "SIGHUP: nothing is changed: " + read.error().message());
    return;
  }
  constexpr std::array<std::string_view, 6> kMount = {"scanner.vertical_x",     "scanner.vertical_y",
                                                      "scanner.vertical_z",     "scanner.vertical_roll",
                                                      "scanner.vertical_pitch", "scanner.vertical_yaw"};
  std::vector<std::string> taken;
  std::vector<std::string> refused;
  for (const std::string& key : changed_keys(configuration_, *read)) {
    const bool can_change = key.starts_with("button.") || key.starts_with("hook.") ||
                            std::find(kMount.begin(), kMount.end(), key) != kMount.end();
    (can_change ? taken : refused).push_back(key);
  }
  configuration_.button = read->button;
  configuration_.hook = read->hook;
  configuration_.scanner.vertical_mount = read->scanner.vertical_mount;
  button_->configure(configuration_.button);
  hook_.configure(configuration_.hook);
  run_.saver().set_mount(configuration_.scanner.vertical_mount);
  log(Severity::kInfo, taken.empty() ? "SIGHUP: nothing new that can be taken while it runs"
                                     : fmt::format("SIGHUP: taken: {}", fmt::join(taken, ", ")));
  if (!refused.empty()) {
    log(Severity::kWarning,
        fmt::format("SIGHUP: stays as it was until submapd is restarted: {}", fmt::join(refused, ", ")));
  }
}

void Control::on_button() {
  log(Severity::kInfo, "the button is pressed");
  ControlRequest request;
  request.verb = ControlVerb::kSaveMap;
  request.cloud = configuration_.button.cloud;
  if (const Expected<SaveProgress> started = start_save(request); !started) {
    log(Severity::kWarning, "the button saves nothing: " + started.error().message());
  }
}

void Control::on_input() {
  while (const std::optional<LcmRequest> request = inputs_->take()) {
    if (!request->command) {
      (void)answer_request(request->request, {});  // a trigger
      continue;
    }
    const ControlReply reply =
        request->status.ok() ? answer_request(request->request, {}) : refusal(request->request.id, request->status);
    if (request->status.ok()) {
      log(Severity::kInfo,
          fmt::format("{} {} by LCM: {}", verb_name(request->request.verb), request->request.name, reply.message));
    }
    run_.publish(*request->command, reply);
    if (reply.state == ReplyState::kWorking) waiting_command_ = request->command;
  }
}

void Control::on_timer() {
  std::uint64_t expirations = 0;
  if (::read(timer_fd_, &expirations, sizeof expirations) != sizeof expirations) return;
  const std::int64_t now_ns = driver::monotonic_now_ns();
  if (now_ns - looked_at_button_ns_ >= kButtonLook_ns) {
    looked_at_button_ns_ = now_ns;
    button_->look();
  }
  tell(look(), now_ns);
  tell_waiting();
  server_->look(now_ns);
  if (service_.watchdog_ns() > 0 && now_ns - fed_ns_ >= service_.watchdog_ns() && run_.all_moved()) {
    fed_ns_ = now_ns;
    service_.feed_watchdog();
  }
}

Health Control::look() {
  Health health = run_.look();
  health.clients = server_->counters();
  health.hook_failed = hook_.failed();
  health.button_trouble = button_->trouble();
  if (inputs_ != nullptr) health.inputs = inputs_->counters();
  health.longest_turn_ms = 1e-6 * static_cast<double>(loop_.longest_turn_ns());
  return health;
}

void Control::tell(Health health, std::int64_t now_ns) {
  const bool news = !last_ || differs(*last_, health);
  if (news || now_ns - published_ns_ >= kSecond_ns) {
    published_ns_ = now_ns;
    run_.publish(health);
    service_.status(words_of(health));
  }
  tell_trouble(health);
  last_ = std::move(health);
}

// Each trouble once when it comes, and a word when all is well again.
void Control::tell_trouble(const Health& health) {
  const std::string trouble = trouble_of(health);
  if (trouble == told_) return;
  told_ = trouble;
  log(trouble.empty() ? Severity::kInfo : Severity::kWarning, trouble.empty() ? "all is well" : trouble);
}

void Control::tell_waiting() {
  const SaveProgress progress = run_.saver().progress();
  if (progress.state == told_progress_.state && progress.percent == told_progress_.percent &&
      progress.name == told_progress_.name && progress.ended_ns == told_progress_.ended_ns) {
    return;
  }
  if (progress.state == SaveState::kDone && !progress.picture_only) {
    log(Severity::kInfo, "saved " + progress.path);
    hook_.tell({"map-saved", progress.path, "saved " + progress.name});
  }
  if (progress.state == SaveState::kFailed) {
    log(Severity::kError, fmt::format("map {} is not saved: {}", progress.name, progress.status.message()));
    if (!progress.picture_only) hook_.tell({"save-failed", "", progress.status.message()});
  }
  told_progress_ = progress;
  const bool drawn = progress.state == SaveState::kDone && progress.picture_only;
  const int picture = drawn ? ::open(progress.path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
  const ControlReply reply = reply_of(progress.id, progress);
  for (const std::uint64_t client : waiting_) server_->send(client, encode_reply(reply), picture);
  if (picture >= 0) ::close(picture);
  if (waiting_command_ && progress.id == waiting_command_->id()) run_.publish(*waiting_command_, reply);
  if (progress.state == SaveState::kWorking) return;
  waiting_command_.reset();
  for (const std::uint64_t client : waiting_) server_->keep(client, false);
  waiting_.clear();
}

std::string Control::answer(std::string_view packet, const ControlPeer& peer) {
  const Expected<ControlRequest> request = parse_request(packet);
  if (!request) return encode_reply(refusal("", request.error()));
  if (request->verb != ControlVerb::kStatus && request->verb != ControlVerb::kHealth) {
    log(Severity::kInfo,
        fmt::format("{} {} by user {}, process {}", verb_name(request->verb), request->name, peer.uid, peer.pid));
  }
  return encode_reply(answer_request(*request, peer));
}

ControlReply Control::answer_request(const ControlRequest& request, const ControlPeer& peer) {
  switch (request.verb) {
    case ControlVerb::kStatus:
    case ControlVerb::kHealth:
      return answer_health(request);
    case ControlVerb::kSaveMap:
      return answer_save(request, peer);
    case ControlVerb::kGetMap:
      return answer_picture(request, peer);
    case ControlVerb::kMark:
      return answer_mark(request);
    case ControlVerb::kPause:
    case ControlVerb::kResume:
    case ControlVerb::kNewRun:
      return answer_command(request);
  }
  return refusal(request.id, {StatusCode::kInternal, "unknown verb"});
}

ControlReply Control::answer_health(const ControlRequest& request) {
  const Health health = last_ ? *last_ : look();
  return {request.id, ReplyState::kDone, words_of(health), StatusCode::kOk, {{"health", json_of(health)}}};
}

Expected<SaveProgress> Control::start_save(const ControlRequest& request) {
  Expected<SaveProgress> progress =
      run_.saver().start({request.id, request.name, request.force, request.cloud, false, marks_.in_order()});
  hook_.tell(progress ? HookEvent{"save-started", "", "saving " + progress->name}
                      : HookEvent{"save-refused", "", progress.error().message()});
  return progress;
}

ControlReply Control::answer_picture(const ControlRequest& request, const ControlPeer& peer) {
  const Expected<SaveProgress> progress = run_.saver().start({request.id, "live", true, false, true, {}});
  if (!progress) return refusal(request.id, progress.error());
  waiting_.insert(peer.client);
  server_->keep(peer.client, true);
  return reply_of(request.id, *progress);
}

ControlReply Control::answer_save(const ControlRequest& request, const ControlPeer& peer) {
  const Expected<SaveProgress> progress = start_save(request);
  if (!progress) return refusal(request.id, progress.error());
  if (request.wait && progress->state == SaveState::kWorking) {
    waiting_.insert(peer.client);
    server_->keep(peer.client, true);
  }
  return reply_of(request.id, *progress);
}

ControlReply Control::answer_mark(const ControlRequest& request) {
  std::optional<Mark> mark = marks_.find(request.id, request.name, request.utime_us);
  if (!mark) {
    if (marks_.full()) {
      return refusal(request.id,
                     {StatusCode::kExhausted, fmt::format("the run has {} marks already", MarkList::kMost)});
    }
    mark = Mark{request.name, request.utime_us.value_or(run_.clock().utime_us())};
    if (!run_.recorder().note(MarkSet{mark->utime_us, mark->name})) {
      return refusal(request.id, {StatusCode::kUnavailable, "the disk does not keep up; try again"});
    }
    marks_.add(request.id, *mark);
  }
  return {request.id,
          ReplyState::kDone,
          fmt::format("marked {}", mark->name),
          StatusCode::kOk,
          {{"utime_us", mark->utime_us}}};
}

ControlReply Control::answer_command(const ControlRequest& request) {
  if (request.verb == ControlVerb::kNewRun) {
    end_ = End::kNewRun;
    loop_.stop();
    return {request.id, ReplyState::kDone, "the run ends, the next begins"};
  }
  const bool pause = request.verb == ControlVerb::kPause;
  if (Status status = pause ? run_.pause() : run_.resume(); !status.ok()) return refusal(request.id, status);
  return {request.id, ReplyState::kDone, pause ? "paused" : "mapping goes on"};
}

}  // namespace submapd
