// The scans of both scanners in a recorded log, each with its role and where it came from.
//
// One thread; blocks on the disk.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "driver/sensor_roles.hpp"
#include "proto/channels.hpp"
#include "proto/scan_conversion.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd {

// A CARMEN log's scans are the horizontal scanner's, from nowhere.
struct LoggedScan {
  driver::SensorRole role = driver::SensorRole::kHorizontal;
  ScanMessage message;
};

class ScanLog {
 public:
  // What replay takes. Errors: those of tools::open_log().
  [[nodiscard]] static Expected<std::unique_ptr<ScanLog>> open(const std::string& path, const Channels& channels);
  // The same for any bytes, of which scans of other runs than `run` are left out.
  [[nodiscard]] static Expected<std::unique_ptr<ScanLog>> open(std::unique_ptr<tools::ByteSource> bytes,
                                                               const std::string& name, const Channels& channels,
                                                               const Uuid& run);
  ScanLog(const ScanLog&) = delete;
  ScanLog& operator=(const ScanLog&) = delete;

  // Nothing at the end. Errors: kIo.
  [[nodiscard]] Expected<std::optional<LoggedScan>> next();
  [[nodiscard]] const tools::LogSummary& summary() const { return reader_->summary(); }

 private:
  ScanLog(Channels channels, std::optional<Uuid> run) : channels_(std::move(channels)), run_(run) {}
  [[nodiscard]] Expected<std::optional<Scan>> decode(std::string_view channel, std::span<const std::byte> data);
  [[nodiscard]] tools::ScanDecoder decoder();

  struct About {
    driver::SensorRole role;
    ScanOrigin origin;
  };
  const Channels channels_;
  const std::optional<Uuid> run_;
  std::deque<About> about_;  // scans that are decoded and not handed on: a reader looks one ahead
  std::unique_ptr<tools::LogReader> reader_;
};

}  // namespace submapd
