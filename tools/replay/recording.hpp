// A log's scans, and whose they are.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "proto/scan_conversion.hpp"
#include "slam/base/status.hpp"
#include "tools/log/log_reader.hpp"

namespace submapd::tools {

struct Recording {
  std::unique_ptr<LogReader> reader;
  std::optional<ScanOrigin> origin;  // what the first scan says; nothing if the log does not tell
};

// `prefix`: of the LCM channels. Errors: those of open_log().
[[nodiscard]] Expected<Recording> open_recording(const std::string& log, const std::string& prefix);

}  // namespace submapd::tools
