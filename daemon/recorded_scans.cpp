#include "daemon/recorded_scans.hpp"

#include <fmt/format.h>

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "proto/scan_conversion.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/log/raw_series.hpp"

namespace submapd {
namespace {

class RecordedScans final : public CloudScans {
 public:
  RecordedScans(std::string scans, std::string intensities)
      : scans_(std::move(scans)), intensities_(std::move(intensities)) {}

  // Without any scan of this scanner there is nothing to read.
  Status open(std::vector<std::filesystem::path> files) {
    if (files.empty()) return {};
    const std::string name = files.front().string();
    Expected<std::unique_ptr<tools::ByteSource>> bytes = tools::open_series(std::move(files));
    if (!bytes) return bytes.error();
    auto reader = tools::open_log(
        std::move(*bytes), name,
        [this](std::string_view channel, std::span<const std::byte> data) { return decode(channel, data); });
    if (reader) reader_ = std::move(*reader);
    return reader || reader.error().code() != StatusCode::kIo ? Status() : reader.error();
  }

  Expected<std::optional<CloudScan>> next() override {
    if (reader_ == nullptr) return std::nullopt;
    Expected<std::optional<Scan>> scan = reader_->next();
    if (!scan) return failure(scan.error());
    if (!*scan) return std::nullopt;
    CloudScan result{std::move(**scan), {}};
    if (last_ && last_->index == result.scan.index) result.intensities = std::move(last_->values);
    last_.reset();
    return result;
  }

 private:
  Expected<std::optional<Scan>> decode(std::string_view channel, std::span<const std::byte> data) {
    if (channel == intensities_) {
      Expected<ScanIntensities> intensities = decode_intensities(data);
      if (!intensities) return failure(intensities.error());
      last_ = std::move(*intensities);
      return std::nullopt;
    }
    if (channel != scans_) return std::nullopt;
    Expected<ScanMessage> message = decode_scan(data);
    if (!message) return failure(message.error());
    return std::optional<Scan>(std::move(message->scan));
  }

  const std::string scans_;
  const std::string intensities_;
  std::unique_ptr<tools::LogReader> reader_;
  std::optional<ScanIntensities> last_;  // of the scan that comes next
};

}  // namespace

Expected<std::unique_ptr<CloudScans>> open_recorded_scans(const std::filesystem::path& run, const Channels& channels,
                                                          driver::SensorRole role) {
  std::error_code error;
  if (!std::filesystem::is_directory(run, error)) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot be read", run.string()));
  }
  const bool horizontal = role == driver::SensorRole::kHorizontal;
  auto scans = std::make_unique<RecordedScans>(horizontal ? channels.scan_h : channels.scan_v,
                                               horizontal ? channels.intensity_h : channels.intensity_v);
  if (Status status = scans->open(tools::raw_files_in(run)); !status.ok()) return failure(status);
  return scans;
}

}  // namespace submapd
