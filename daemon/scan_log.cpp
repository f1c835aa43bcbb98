#include "daemon/scan_log.hpp"

#include <utility>

namespace submapd {

Expected<std::unique_ptr<ScanLog>> ScanLog::open(const std::string& path, const Channels& channels) {
  std::unique_ptr<ScanLog> log(new ScanLog(channels, std::nullopt));
  auto reader = tools::open_log(path, log->decoder());
  if (!reader) return failure(reader.error());
  log->reader_ = std::move(*reader);
  return log;
}

Expected<std::unique_ptr<ScanLog>> ScanLog::open(std::unique_ptr<tools::ByteSource> bytes, const std::string& name,
                                                 const Channels& channels, const Uuid& run) {
  std::unique_ptr<ScanLog> log(new ScanLog(channels, run));
  auto reader = tools::open_log(std::move(bytes), name, log->decoder());
  if (!reader) return failure(reader.error());
  log->reader_ = std::move(*reader);
  return log;
}

tools::ScanDecoder ScanLog::decoder() {
  return [this](std::string_view channel, std::span<const std::byte> data) { return decode(channel, data); };
}

Expected<std::optional<Scan>> ScanLog::decode(std::string_view channel, std::span<const std::byte> data) {
  const bool horizontal = channel == channels_.scan_h;
  if (!horizontal && channel != channels_.scan_v) return std::nullopt;
  Expected<ScanMessage> message = decode_scan(data);
  if (!message) return failure(message.error());
  if (run_ && message->origin.run != *run_) return std::nullopt;
  about_.push_back({horizontal ? driver::SensorRole::kHorizontal : driver::SensorRole::kVertical, message->origin});
  return std::optional<Scan>(std::move(message->scan));
}

Expected<std::optional<LoggedScan>> ScanLog::next() {
  Expected<std::optional<Scan>> scan = reader_->next();
  if (!scan) return failure(scan.error());
  if (!scan->has_value()) return std::nullopt;
  LoggedScan logged;
  if (!about_.empty()) {
    logged.role = about_.front().role;
    logged.message.origin = about_.front().origin;
    about_.pop_front();
  }
  logged.message.scan = std::move(**scan);
  return logged;
}

}  // namespace submapd
