#include "tools/log/log_reader.hpp"

#include <fmt/format.h>

#include <utility>

#include "tools/log/carmen_reader.hpp"
#include "tools/log/input_buffer.hpp"
#include "tools/log/lcm_reader.hpp"
#include "tools/log/raw_series.hpp"
#include "tools/log/unpack.hpp"

namespace submapd::tools {
namespace {

constexpr std::size_t kMagicWindow = std::size_t{64} << 10;

// Hands out the scan that was read to see whether this is a log, then all others.
class OpenedReader final : public LogReader {
 public:
  OpenedReader(std::unique_ptr<LogReader> reader, Scan first) : reader_(std::move(reader)), first_(std::move(first)) {}

  Expected<std::optional<Scan>> next() override {
    if (first_) return std::exchange(first_, std::nullopt);
    return reader_->next();
  }
  const LogSummary& summary() const override { return reader_->summary(); }
  double progress() const override { return reader_->progress(); }

 private:
  std::unique_ptr<LogReader> reader_;
  std::optional<Scan> first_;
};

Expected<InputBuffer> unpacked(std::unique_ptr<ByteSource> source) {
  InputBuffer raw(std::move(source));
  const auto front = raw.peek(kMagicWindow);
  if (!is_gzip(front) && !is_xz(front)) return raw;
  auto unpacking = is_gzip(front) ? open_gzip(std::move(raw)) : open_xz(std::move(raw));
  if (!unpacking) return failure(unpacking.error());
  return InputBuffer(std::move(*unpacking));
}

Status no_scan(const std::string& name, const LogSummary& summary) {
  std::string found = fmt::format("{} odometry, {} other and {} damaged records", summary.odometry_records,
                                  summary.other_records, summary.skipped_records);
  if (!summary.problems.empty()) found += fmt::format("; first problem: {}", summary.problems.front());
  return {StatusCode::kInvalidArgument,
          fmt::format("{}: holds no laser scan ({}). Give a CARMEN text log with FLASER or ROBOTLASER1 lines or an "
                      ".lcmlog with a scan channel, plain, .gz or .xz",
                      name, found)};
}

}  // namespace

Expected<std::unique_ptr<LogReader>> open_log(const std::string& path, ScanDecoder decoder) {
  auto file = open_series(files_of_log(path));
  if (!file) return failure(file.error());
  return open_log(std::move(*file), path, std::move(decoder));
}

Expected<std::unique_ptr<LogReader>> open_log(std::unique_ptr<ByteSource> source, const std::string& name,
                                              ScanDecoder decoder) {
  auto input = unpacked(std::move(source));
  if (!input) return failure(input.error().code(), fmt::format("{}: {}", name, input.error().message()));
  const bool is_lcm = has_lcm_event(input->peek(kMagicWindow));
  std::unique_ptr<LogReader> reader;
  if (is_lcm) {
    reader = std::make_unique<LcmReader>(std::move(*input), std::move(decoder));
  } else {
    reader = std::make_unique<CarmenReader>(std::move(*input));
  }
  auto first = reader->next();
  if (!first) return failure(first.error());
  if (!first->has_value()) return failure(no_scan(name, reader->summary()));
  return std::make_unique<OpenedReader>(std::move(reader), std::move(**first));
}

}  // namespace submapd::tools
