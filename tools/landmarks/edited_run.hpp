// A finished run on the disk, whose graph a person edits: archive, journal and poses, of the daemon or of a replay.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>

#include "daemon/configuration.hpp"
#include "daemon/run_journal.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tools/landmarks/edit_list.hpp"

namespace submapd::tools {

class EditedRun {
 public:
  // Told: sub-maps the graph has, of how many.
  using Progress = std::function<void(std::uint32_t done, std::uint32_t all)>;

  // Errors: kInvalidArgument (no run's folder, or one without sub-maps), kUnavailable (the run has not ended), kCorrupt
  // (a sub-map is not the journal's), kIo.
  [[nodiscard]] static Expected<EditedRun> open(const std::filesystem::path& folder,
                                                const Configuration& configuration);

  [[nodiscard]] EditList edits() const { return edits_of(journal_.records); }
  [[nodiscard]] std::uint32_t submaps() const { return submaps_; }
  [[nodiscard]] SubmapArchive& archive() { return *archive_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }

  // The run's final graph with these edits, from the sub-maps: what replay would have come to. `loops` false: ties of
  // neighbours, and those that were added.
  [[nodiscard]] Expected<FinalResult> solve(const GraphEdits& edits, bool loops, const Progress& progress);

  // On the disk when it returns. A journal of an earlier version is written anew first.
  Status append(const JournalEvent& edit);

 private:
  EditedRun(std::filesystem::path folder, JournalContents journal, const Configuration& configuration)
      : folder_(std::move(folder)),
        journal_(std::move(journal)),
        parts_(configuration.graph_parts),
        graph_bytes_(configuration.graph_bytes) {}
  Status check_submaps();

  std::filesystem::path folder_;
  JournalContents journal_;
  GraphParts parts_;
  std::size_t graph_bytes_;
  std::unique_ptr<SubmapArchive> archive_;
  std::uint32_t submaps_ = 0;
};

}  // namespace submapd::tools
