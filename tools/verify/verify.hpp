// Whether what the daemon left on the disk is whole: a run, a saved map, or one file.
//
// Reads everything, changes nothing. What a power cut leaves at the end of a file that grows is no damage: it is told
// as a remark.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "slam/base/status.hpp"

namespace submapd::tools {

struct VerifyReport {
  std::string what;                   // "run", "map", "log", ...
  std::vector<std::string> problems;  // each with file and place
  std::vector<std::string> remarks;
  std::uint64_t files = 0;
};

// `path`: a run's folder, a map's folder, a log, a journal, a sub-map or a file of poses; told by the content. Errors:
// kNotFound, kIo, kInvalidArgument (none of these).
[[nodiscard]] Expected<VerifyReport> verify(const std::filesystem::path& path);

}  // namespace submapd::tools
