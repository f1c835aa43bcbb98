#include "tools/hokuyo_sim/truth_log.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace submapd::tools {

Expected<std::unique_ptr<TruthLog>> TruthLog::open(const std::string& path) {
  std::FILE* file = nullptr;
  if (path == "-") {
    file = stdout;
  } else if (!path.empty()) {
    file = std::fopen(path.c_str(), "we");
    if (file == nullptr) {
      return failure(StatusCode::kIo, fmt::format("cannot write {}: {}", path, std::strerror(errno)));
    }
  }
  return std::unique_ptr<TruthLog>(new TruthLog(file));
}

TruthLog::~TruthLog() {
  if (file_ != nullptr && file_ != stdout) {
    std::fclose(file_);
  }
}

driver::SimSensor::TruthSink TruthLog::sink(std::size_t number, const std::string& serial, PoseAt pose_at) {
  if (file_ == nullptr) {
    return {};
  }
  return [this, number, serial, pose_at = std::move(pose_at)](const driver::SimScanTruth& scan) {
    std::string faults;
    for (unsigned bit = 0; bit < 32; ++bit) {
      if ((scan.faults >> bit & 1U) != 0) {
        faults += fmt::format("{}\"{}\"", faults.empty() ? "" : ",", name_of(static_cast<driver::SimFaultKind>(bit)));
      }
    }
    std::string pose;
    if (pose_at) {
      const Pose2 at = pose_at(scan.first_beam_ns);
      pose = fmt::format(",\"pose\":[{:.6f},{:.6f},{:.8f}]", at.x, at.y, at.yaw);
    }
    const std::string line = fmt::format(
        "{{\"scanner\":{},\"serial\":\"{}\",\"rotation\":{},\"epoch\":{},\"first_beam_ns\":{},\"stamp_ms\":{},"
        "\"ranges_hash\":\"{:016x}\",\"sent\":{},\"sent_ns\":{},\"faults\":[{}]{}}}\n",
        number, serial, scan.rotation, scan.epoch, scan.first_beam_ns, scan.stamp_ms, scan.ranges_hash, scan.sent,
        scan.sent_ns, faults, pose);
    const std::lock_guard lock(mutex_);
    std::fwrite(line.data(), 1, line.size(), file_);
  };
}

}  // namespace submapd::tools
