#include "tools/landmarks/edited_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <utility>

#include "daemon/run_clock.hpp"
#include "slam/base/atomic_file.hpp"

namespace submapd::tools {
Expected<EditedRun> EditedRun::open(const std::filesystem::path& folder, const Configuration& configuration) {
  std::error_code error;
  if (!std::filesystem::exists(folder / "journal", error) ||
      !std::filesystem::is_directory(folder / "submaps", error)) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{}: no run: it has no journal or no submaps/; give the folder of a run or what replay "
                               "--out made",
                               folder.string()));
  }
  Expected<JournalContents> journal = read_journal(folder / "journal");
  if (!journal) return failure(journal.error());
  const auto ended = [](const JournalRecord& record) { return std::holds_alternative<RunEnded>(record.event); };
  if (std::none_of(journal->records.begin(), journal->records.end(), ended)) {
    return failure(StatusCode::kUnavailable,
                   fmt::format("{}: the run has not ended; end it first (submapctl new-run)", folder.string()));
  }
  EditedRun run(folder, std::move(*journal), configuration);
  Expected<std::unique_ptr<SubmapArchive>> archive =
      SubmapArchive::open(folder / "submaps", configuration.submap_cache_bytes);
  if (!archive) return failure(archive.error());
  run.archive_ = std::move(*archive);
  if (Status status = run.check_submaps(); !status.ok()) return failure(status);
  return run;
}

Status EditedRun::check_submaps() {
  for (const JournalRecord& record : journal_.records) {
    const auto* const saved = std::get_if<SubmapSaved>(&record.event);
    if (saved == nullptr) continue;
    const std::filesystem::path path = archive_->path_of(saved->index);
    const Expected<Sha256> hash = sha256_of_file(path);
    if (!hash) return hash.error();
    if (saved->index != submaps_ || *hash != saved->hash) {
      return {StatusCode::kCorrupt, fmt::format("{}: is not what the journal says (submapctl verify)", path.string())};
    }
    ++submaps_;
  }
  if (submaps_ > 0) return {};
  return {StatusCode::kInvalidArgument, folder_.string() + ": the run has no finished sub-map"};
}

Expected<FinalResult> EditedRun::solve(const GraphEdits& edits, bool loops, const Progress& progress) {
  OptimizerOptions options;
  options.loops = loops;
  options.parts = parts_;
  options.edits = edits;
  options.suspects = true;
  options.graph_bytes_limit = graph_bytes_;
  Optimizer optimizer(options, *archive_);
  for (std::uint32_t k = 0; k < submaps_; ++k) {
    progress(k, submaps_);
    const Expected<std::shared_ptr<const FinishedSubmap>> submap = archive_->load(k);
    if (!submap) return failure(submap.error());
    if (Expected<GraphState> state = optimizer.add_submap(*submap); !state) return failure(state.error());
  }
  progress(submaps_, submaps_);
  return optimizer.finish();
}

Status EditedRun::append(const JournalEvent& edit) {
  const std::filesystem::path path = folder_ / "journal";
  if (journal_.version != kJournalVersion) {
    const std::vector<std::byte> bytes = encode_journal(journal_.cart, journal_.run, journal_.records);
    if (Status status = atomic_write_file(path, bytes); !status.ok()) return status;
    journal_.version = kJournalVersion;
    journal_.whole_bytes = bytes.size();
  }
  const Expected<std::unique_ptr<RunJournal>> journal = RunJournal::reopen(path, journal_);
  if (!journal) return journal.error();
  const JournalRecord record{RunClock::now().utime_us(), edit};
  if (Status status = (*journal)->append(record); !status.ok()) return status;
  journal_.records.push_back(record);
  journal_.whole_bytes += encode_journal_record(record).size();
  return {};
}

}  // namespace submapd::tools
