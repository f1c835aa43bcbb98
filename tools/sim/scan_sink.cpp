#include "tools/sim/scan_sink.hpp"

#include <fmt/compile.h>
#include <fmt/format.h>
#include <zlib.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "proto/channels.hpp"
#include "proto/scan_conversion.hpp"

namespace submapd::tools {
namespace {

// A text file, compressed or not, that gets its name when it is complete.
class OutputFile {
 public:
  explicit OutputFile(std::string path) : path_(std::move(path)), part_(path_ + ".part") {
    const bool compressed = path_.ends_with(".gz");
    file_ = gzopen(part_.c_str(), compressed ? "wb6" : "wbT");
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;
  ~OutputFile() {
    if (file_ != nullptr) {
      gzclose(file_);
      std::remove(part_.c_str());
    }
  }

  [[nodiscard]] Status opened() const { return file_ != nullptr ? Status() : error("open", errno); }

  [[nodiscard]] Status write(std::string_view text) {
    const int written = gzwrite(file_, text.data(), static_cast<unsigned>(text.size()));
    return written == static_cast<int>(text.size()) ? Status() : error("write", errno);
  }

  [[nodiscard]] Status finish() {
    const int closed = gzclose(file_);
    file_ = nullptr;
    if (closed != Z_OK) {
      const Status status = error("write", errno);
      std::remove(part_.c_str());
      return status;
    }
    return std::rename(part_.c_str(), path_.c_str()) == 0 ? Status() : error("rename", errno);
  }

 private:
  [[nodiscard]] Status error(const char* action, int reason) const {
    return {StatusCode::kIo, fmt::format("{}: cannot {}: {}; choose another --out or make room there", part_, action,
                                         std::strerror(reason))};
  }

  std::string path_;
  std::string part_;
  gzFile file_ = nullptr;
};

using Buffer = fmt::memory_buffer;

void append_stamp(Buffer& line, std::int64_t stamp_us) {
  fmt::format_to(std::back_inserter(line), FMT_COMPILE("{}.{:06}"), stamp_us / 1'000'000, stamp_us % 1'000'000);
}

class ClfSink final : public ScanSink {
 public:
  explicit ClfSink(std::string path) : file_(std::move(path)) {}
  [[nodiscard]] Status opened() const { return file_.opened(); }

  Status write(const Scan& scan, const Pose2& /*truth*/) override {
    line_.clear();
    auto out = std::back_inserter(line_);
    const ScanGeometry& geometry = scan.geometry;
    const std::size_t count = scan.ranges_mm.size();
    if (!header_written_) {
      fmt::format_to(out, "# simulated by submapctl\n# sweep_s {}\n", geometry.sweep_s);
      header_written_ = true;
    }
    constexpr int kSimulatedLaser = 3;  // CARMEN's laser types
    fmt::format_to(out, FMT_COMPILE("ROBOTLASER1 {} {:.15f} {:.15f} {:.15f} {:.3f} 0.010 0 {}"), kSimulatedLaser,
                   geometry.first_angle_rad, geometry.angle_step_rad * (static_cast<double>(count) - 1.0),
                   geometry.angle_step_rad, geometry.range_max_m, count);
    for (const std::uint16_t range_mm : scan.ranges_mm) {
      fmt::format_to(out, FMT_COMPILE(" {}.{:03}"), range_mm / 1000, range_mm % 1000);
    }
    const Pose2 odometry = scan.odometry.value_or(Pose2{});
    fmt::format_to(out, FMT_COMPILE(" 0 {0:.6f} {1:.6f} {2:.6f} {0:.6f} {1:.6f} {2:.6f} 0 0 0 0 0 "), odometry.x,
                   odometry.y, odometry.yaw);
    append_stamp(line_, scan.stamp_us);
    fmt::format_to(out, " sim ");
    append_stamp(line_, scan.stamp_us);
    line_.push_back('\n');
    return file_.write({line_.data(), line_.size()});
  }

  Status finish() override { return file_.finish(); }

 private:
  OutputFile file_;
  Buffer line_;
  bool header_written_ = false;
};

// LCM's log: events of a 28-byte big-endian header, the channel and the message, one after the other.
class LcmSink final : public ScanSink {
 public:
  explicit LcmSink(std::string path) : file_(std::move(path)) {}
  [[nodiscard]] Status opened() const { return file_.opened(); }

  Status write(const Scan& scan, const Pose2& /*truth*/) override {
    const std::vector<std::byte> message = encode_scan(scan, ScanOrigin{});
    event_.clear();
    put(kSync, 4);
    put(scan.index, 8);
    put(static_cast<std::uint64_t>(scan.stamp_us), 8);
    put(channel_.size(), 4);
    put(message.size(), 4);
    event_ += channel_;
    event_.append(reinterpret_cast<const char*>(message.data()), message.size());
    return file_.write(event_);
  }

  Status finish() override { return file_.finish(); }

 private:
  static constexpr std::uint64_t kSync = 0xEDA1DA01;

  void put(std::uint64_t value, int bytes) {
    for (int i = bytes - 1; i >= 0; --i) event_ += static_cast<char>((value >> (8 * i)) & 0xFF);
  }

  OutputFile file_;
  std::string event_;
  const std::string channel_ = Channels().scan_h;
};

class TruthSink final : public ScanSink {
 public:
  explicit TruthSink(std::string path) : file_(std::move(path)) {}
  [[nodiscard]] Status opened() const { return file_.opened(); }

  Status write(const Scan& scan, const Pose2& truth) override {
    line_.clear();
    append_stamp(line_, scan.stamp_us);
    fmt::format_to(std::back_inserter(line_), FMT_COMPILE(" {:.9f} {:.9f} 0 0 0 {:.12f} {:.12f}\n"), truth.x, truth.y,
                   std::sin(truth.yaw / 2.0), std::cos(truth.yaw / 2.0));
    return file_.write({line_.data(), line_.size()});
  }

  Status finish() override { return file_.finish(); }

 private:
  OutputFile file_;
  Buffer line_;
};

template <typename Sink>
Expected<std::unique_ptr<ScanSink>> open_sink(const std::string& path) {
  auto sink = std::make_unique<Sink>(path);
  if (Status status = sink->opened(); !status.ok()) {
    return failure(std::move(status));
  }
  return sink;
}

}  // namespace

Expected<std::unique_ptr<ScanSink>> open_clf_sink(const std::string& path) {
  return open_sink<ClfSink>(path);
}

Expected<std::unique_ptr<ScanSink>> open_lcm_sink(const std::string& path) {
  return open_sink<LcmSink>(path);
}

Expected<std::unique_ptr<ScanSink>> open_truth_sink(const std::string& path) {
  return open_sink<TruthSink>(path);
}

}  // namespace submapd::tools
