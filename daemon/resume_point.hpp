// A run that ended by a crash or a power cut, and where it goes on.
//
// Its journal has no "run ended". Finished sub-maps and marks are what journal and archive have; what was mapped after
// the newest finished sub-map is mapped once more from the raw log. Set-up code, one thread; blocks on the disk.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/run_folder.hpp"
#include "daemon/run_journal.hpp"
#include "proto/channels.hpp"
#include "slam/output/run_outputs.hpp"
#include "slam/output/standstill.hpp"

namespace submapd {

// A run that stopped so often without another finished sub-map is left as it is: perhaps it is what makes us stop.
inline constexpr int kMostContinued = 5;

struct ResumePoint {
  JournalContents journal;
  std::vector<Sha256> hashes;                  // of the finished sub-maps, by index
  std::size_t adopted = 0;                     // of them, the last ones: on the disk and not in the journal yet
  std::shared_ptr<const FinishedSubmap> last;  // the newest; null if there is none
  std::vector<Mark> marks;                     // in order of time
  std::vector<std::filesystem::path> raw_files;
  int next_raw_file = 0;
  std::vector<Standstill> standstills;  // of the part that is mapped again
  // Of the raw log's scans and the sub-maps' key-frames, by SensorRole.
  std::array<std::uint64_t, driver::kSensorRoles> next_index{};
  std::array<std::int64_t, driver::kSensorRoles> last_stamp_us{};

  // Up to here poses of scans are kept; what is later is mapped again.
  [[nodiscard]] std::int64_t mapped_until_us() const {
    return last ? last->keyframes.back().stamp_us : std::numeric_limits<std::int64_t>::min();
  }
};

struct UnfinishedRun {
  RunFolder folder;  // its clock is still to be set
  ResumePoint point;
};

// The run that STATE/current-run names, if it can go on with scans of that kind of input. kNotFound if there is none
// or it has ended; other errors say why it cannot go on. Removes what a crash left half written.
[[nodiscard]] Expected<UnfinishedRun> find_unfinished_run(const Configuration& configuration, const std::string& input);

// The recorded scans of the horizontal scanner after scan `after`, one a call, then nothing.
[[nodiscard]] std::function<std::optional<Scan>()> scans_after(const ResumePoint& point, const Uuid& run,
                                                               const Channels& channels,
                                                               std::optional<std::uint64_t> after);

}  // namespace submapd
