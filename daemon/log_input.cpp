#include "daemon/log_input.hpp"

#include <fmt/format.h>

#include <chrono>
#include <exception>
#include <utility>

#include "daemon/daemon_log.hpp"
#include "daemon/realtime.hpp"
#include "proto/channels.hpp"

namespace submapd {
namespace {

constexpr std::chrono::milliseconds kRest{100};  // between heartbeats

}  // namespace

Expected<std::unique_ptr<LogInput>> LogInput::open(const std::string& path, const Configuration& configuration,
                                                   driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell) {
  std::unique_ptr<LogInput> input(new LogInput(configuration, mapper_bell, recorder_bell));
  Expected<std::unique_ptr<ScanLog>> scans = ScanLog::open(path, Channels(configuration.lcm.prefix));
  if (!scans) return failure(scans.error());
  Expected<std::optional<LoggedScan>> first = (*scans)->next();
  if (!first) return failure(first.error());
  const Scan& scan = (*first)->message.scan;
  if (scan.ranges_mm.size() > driver::DeviceScan::kMaxBeams) {
    return failure(StatusCode::kInvalidArgument, fmt::format("{}: scans of {} beams; the daemon takes up to {}", path,
                                                             scan.ranges_mm.size(), driver::DeviceScan::kMaxBeams));
  }
  input->geometry_ = scan.geometry;
  input->now_ns_->store(scan.stamp_us * 1000);
  input->log_ = std::move(*scans);
  input->first_ = std::move(*first);
  return input;
}

LogInput::~LogInput() {
  stop();
}

Status LogInput::start() {
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  return {};
}

void LogInput::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  if (room_ != nullptr) room_->ring();
  thread_.join();
}

std::string LogInput::trouble() const {
  const MutexLock lock(mutex_);
  return trouble_;
}

void LogInput::run(const std::stop_token& stop) {
  name_thread("input");
  Status status;
  try {
    status = feed(stop);
  } catch (const std::exception& error) {  // no memory
    status = Status(StatusCode::kInternal, error.what());
  }
  if (stop.stop_requested()) return;
  {
    const MutexLock lock(mutex_);
    trouble_ = status.message();
  }
  ended_.store(true);
  log(Severity::kInfo, "the log has ended; the run stays open: save-map, or end the daemon");
  while (!stop.stop_requested()) {
    heartbeat_.beat();
    std::this_thread::sleep_for(kRest);
  }
}

Status LogInput::feed(const std::stop_token& stop) {
  std::uint64_t refused = 0;
  while (!stop.stop_requested()) {
    Expected<std::optional<LoggedScan>> next = first_ ? std::exchange(first_, std::nullopt) : log_->next();
    if (!next) return next.error();
    if (!next->has_value()) break;
    const auto& [role, message] = **next;
    if (!fits(message.scan)) {
      ++refused;
      continue;
    }
    if (message.scan.stamp_us <= skip_until_us_[static_cast<std::size_t>(role)]) continue;
    const auto may_go_on = [&] { return has_room_() || stop.stop_requested(); };
    while (room_ != nullptr && !room_->wait(may_go_on, kRest)) heartbeat_.beat();
    const std::int64_t now_ns = message.scan.stamp_us * 1000;
    now_ns_->store(std::max(now_ns, now_ns_->load()));
    push(role, message);
    heartbeat_.beat();
  }
  const std::uint64_t damaged = log_->summary().skipped_records;
  if (refused + damaged == 0) return {};
  return {StatusCode::kCorrupt,
          fmt::format("the log has {} damaged records and {} scans of another scanner", damaged, refused)};
}

}  // namespace submapd
