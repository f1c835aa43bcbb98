// The raw files of a run - raw-0000.lcmlog, raw-0001.lcmlog, ... - as one log.
//
// Set-up code and a ByteSource; one thread.
#pragma once

#include <filesystem>
#include <memory>
#include <vector>

#include "tools/log/byte_source.hpp"

namespace submapd::tools {

// In order of their numbers; empty if the folder has none or is none.
[[nodiscard]] std::vector<std::filesystem::path> raw_files_in(const std::filesystem::path& folder);

// The number that none of these has, greater than all.
[[nodiscard]] int next_raw_number(const std::vector<std::filesystem::path>& files);

// The files that `path` means: all raw files for a run's folder and for its first raw file, else `path` itself.
[[nodiscard]] std::vector<std::filesystem::path> files_of_log(const std::filesystem::path& path);

// The files one after the other. A file that ends within an event is no harm: readers go on at the next one's start.
// REQUIRES: there is one. Errors: those of open_file() for the first; later ones show in read().
[[nodiscard]] Expected<std::unique_ptr<ByteSource>> open_series(std::vector<std::filesystem::path> files);

}  // namespace submapd::tools
