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

constexpr std::chrono::microseconds kLookAgain{50};
constexpr std::chrono::milliseconds kRest{100};

}  // namespace

Expected<std::unique_ptr<LogInput>> LogInput::open(const std::string& path, const Configuration& configuration,
                                                   driver::Doorbell& mapper_bell, driver::Doorbell& recorder_bell) {
  std::unique_ptr<LogInput> input(new LogInput(configuration, mapper_bell, recorder_bell));
  auto reader = tools::open_log(
      path,
      [self = input.get(), channels = Channels(configuration.lcm.prefix)](
          std::string_view channel, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
        const bool horizontal = channel == channels.scan_h;
        if (!horizontal && channel != channels.scan_v) return std::optional<Scan>{};
        Expected<ScanMessage> message = decode_scan(data);
        if (!message) return failure(message.error());
        self->about_.push_back(
            {horizontal ? driver::SensorRole::kHorizontal : driver::SensorRole::kVertical, message->origin});
        return std::optional<Scan>(std::move(message->scan));
      });
  if (!reader) return failure(reader.error());
  Expected<std::optional<Scan>> first = (*reader)->next();
  if (!first) return failure(first.error());
  if ((*first)->ranges_mm.size() > driver::DeviceScan::kMaxBeams) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{}: scans of {} beams; the daemon takes up to {}", path, (*first)->ranges_mm.size(),
                               driver::DeviceScan::kMaxBeams));
  }
  input->reader_ = std::move(*reader);
  input->first_ = std::move(*first);
  input->geometry_ = input->first_->geometry;
  input->now_ns_->store(input->first_->stamp_us * 1000);
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
    Expected<std::optional<Scan>> scan = first_ ? std::exchange(first_, std::nullopt) : reader_->next();
    if (!scan) return scan.error();
    if (!scan->has_value()) break;
    About about{driver::SensorRole::kHorizontal, {}};  // of a CARMEN log
    if (!about_.empty()) {
      about = about_.front();
      about_.pop_front();
    }
    ScanMessage message{about.origin, std::move(**scan)};
    if (!fits(message.scan)) {
      ++refused;
      continue;
    }
    if (message.scan.stamp_us <= skip_until_us_[static_cast<std::size_t>(about.role)]) continue;
    while (!ready_() && !stop.stop_requested()) {
      heartbeat_.beat();
      std::this_thread::sleep_for(kLookAgain);
    }
    const std::int64_t now_ns = message.scan.stamp_us * 1000;
    now_ns_->store(std::max(now_ns, now_ns_->load()));
    push(about.role, message);
    heartbeat_.beat();
  }
  const std::uint64_t damaged = reader_->summary().skipped_records;
  if (refused + damaged == 0) return {};
  return {StatusCode::kCorrupt,
          fmt::format("the log has {} damaged records and {} scans of another scanner", damaged, refused)};
}

}  // namespace submapd
