// A recorded log through the whole pipeline: mapper, sub-maps over LCM, optimizer thread, saved map (design section 7).
//
// The same parts as in the daemon, in one thread but for the optimizer's: the next scan waits until the optimizer has
// answered for a finished sub-map, so that the result does not depend on time. With workers the mappers are several
// (chunked_mapping.hpp).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "daemon/configuration.hpp"
#include "slam/base/status.hpp"

namespace submapd::tools {

struct ReplayOptions {
  std::string log;
  std::filesystem::path out;  // made if missing; files of an earlier replay are replaced
  Configuration configuration;
  int threads = 1;  // of the particle filter; the result is the same for any number
  // 0: one mapper goes through the log. Else the log is mapped in chunks by so many at once, each with the memory of
  // one mapper; the result is the same for any number, and another than without.
  int workers = 0;
  bool loops = true;
};

// What replay tells while it works: scans so far, share of the log, sub-maps, confirmed loops.
struct ReplayProgress {
  std::uint64_t scans = 0;
  double share = 0.0;
  std::uint64_t submaps = 0;
  std::uint64_t loops = 0;
  const char* stage = "mapping";
};

struct ReplayResult {
  std::string summary;  // a few lines for people
};

[[nodiscard]] Expected<ReplayResult> replay(const ReplayOptions& options,
                                            const std::function<void(const ReplayProgress&)>& progress);

}  // namespace submapd::tools
