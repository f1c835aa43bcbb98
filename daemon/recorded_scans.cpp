#include "daemon/recorded_scans.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "proto/scan_conversion.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd {
namespace {

class RecordedScans final : public CloudScans {
 public:
  RecordedScans(std::vector<std::filesystem::path> files, std::string scans, std::string intensities)
      : files_(std::move(files)), scans_(std::move(scans)), intensities_(std::move(intensities)) {}

  Expected<std::optional<CloudScan>> next() override {
    for (;;) {
      if (reader_ == nullptr) {
        if (next_file_ == files_.size()) return std::nullopt;
        auto reader = tools::open_log(
            files_[next_file_++].string(),
            [this](std::string_view channel, std::span<const std::byte> data) { return decode(channel, data); });
        if (!reader && reader.error().code() == StatusCode::kIo) return failure(reader.error());
        if (!reader) continue;  // without a scan of this scanner
        reader_ = std::move(*reader);
      }
      Expected<std::optional<Scan>> scan = reader_->next();
      if (!scan) return failure(scan.error());
      if (!*scan) {
        reader_.reset();
        continue;
      }
      CloudScan result{std::move(**scan), {}};
      if (last_ && last_->index == result.scan.index) result.intensities = std::move(last_->values);
      last_.reset();
      return result;
    }
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

  const std::vector<std::filesystem::path> files_;
  const std::string scans_;
  const std::string intensities_;
  std::size_t next_file_ = 0;
  std::unique_ptr<tools::LogReader> reader_;
  std::optional<ScanIntensities> last_;  // of the scan that comes next
};

}  // namespace

Expected<std::unique_ptr<CloudScans>> open_recorded_scans(const std::filesystem::path& run, const Channels& channels,
                                                          driver::SensorRole role) {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  for (auto entry = std::filesystem::directory_iterator(run, error); !error && entry != end(entry);
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.starts_with("raw-") && name.ends_with(".lcmlog")) files.push_back(entry->path());
  }
  if (error) return failure(StatusCode::kIo, fmt::format("{}: {}", run.string(), error.message()));
  std::sort(files.begin(), files.end());
  const bool horizontal = role == driver::SensorRole::kHorizontal;
  return std::make_unique<RecordedScans>(std::move(files), horizontal ? channels.scan_h : channels.scan_v,
                                         horizontal ? channels.intensity_h : channels.intensity_v);
}

}  // namespace submapd
