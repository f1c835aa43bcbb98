// The way of a finished sub-map in a replay: archive, journal of hashes, LCM, optimizer thread.
//
// One thread feeds. The caller waits for the optimizer's answer, so that nothing depends on time.
#pragma once

#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <vector>

#include "daemon/configuration.hpp"
#include "daemon/optimizer_thread.hpp"
#include "daemon/run_journal.hpp"
#include "daemon/submap_journal.hpp"
#include "daemon/submap_publisher.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tools/replay/metrics.hpp"

namespace submapd::tools {

class SubmapFeed {
 public:
  SubmapFeed(const Configuration& configuration, bool loops, const Uuid& cart, const Uuid& run,
             std::unique_ptr<SubmapArchive> archive);

  // The next sub-map, in order of index, through all of it.
  Status feed(const FinishedSubmap& finished);
  // A journal as the daemon keeps one, for submapctl landmarks and verify.
  Status write_journal(const std::filesystem::path& path) const;
  // The remaining loops and the final graph; notes in `metrics` what that took.
  Expected<FinalResult> finish(ReplayMetrics& metrics);

  // By the newest sub-map of the graph.
  [[nodiscard]] const Pose2& map_from_odom() const { return map_from_odom_; }
  [[nodiscard]] std::uint64_t submaps() const { return fed_; }
  [[nodiscard]] std::uint64_t confirmed_loops() const { return thread_.back_end_counters().loops_confirmed; }
  [[nodiscard]] SubmapArchive& archive() { return *archive_; }

 private:
  const std::size_t graph_bytes_limit_;
  std::unique_ptr<SubmapArchive> archive_;
  SubmapJournal journal_;
  lcm::LCM lcm_;
  SubmapPublisher publisher_;
  Optimizer optimizer_;
  OptimizerThread thread_;
  const Uuid cart_;
  const Uuid run_;
  std::vector<JournalRecord> records_;
  Pose2 map_from_odom_;
  std::uint64_t fed_ = 0;
};

}  // namespace submapd::tools
