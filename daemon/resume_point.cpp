#include "daemon/resume_point.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <utility>

#include "daemon/map_folder.hpp"
#include "daemon/scan_log.hpp"
#include "slam/base/atomic_file.hpp"
#include "slam/submap/submap_archive.hpp"
#include "tools/log/raw_series.hpp"

namespace submapd {
namespace {

namespace fs = std::filesystem;

Expected<fs::path> current_run(const fs::path& state) {
  std::string name;
  if (std::ifstream file(state / "current-run"); file) std::getline(file, name);
  if (!is_name(name)) return failure(StatusCode::kNotFound, "no run has begun yet");
  return state / "runs" / name;
}

// What journal and archive know of the run. Everything that must be known to go on is checked here.
Status read_records(const JournalContents& journal, const std::string& input, ResumePoint& point) {
  int continued = 0;
  for (const JournalRecord& record : journal.records) {
    if (std::holds_alternative<RunEnded>(record.event)) return {StatusCode::kNotFound, "the run has ended"};
    if (const auto* const submap = std::get_if<SubmapSaved>(&record.event)) {
      if (submap->index != point.hashes.size()) {
        return {StatusCode::kCorrupt,
                fmt::format("its journal has sub-map {} where {} is due", submap->index, point.hashes.size())};
      }
      point.hashes.push_back(submap->hash);
      continued = 0;
    } else if (const auto* const mark = std::get_if<MarkSet>(&record.event)) {
      point.marks.push_back({mark->name, mark->utime_us});
    } else if (std::holds_alternative<RunContinued>(record.event)) {
      ++continued;
    } else if (const auto* const kind = std::get_if<InputIs>(&record.event); kind != nullptr && kind->kind != input) {
      return {StatusCode::kNotFound, fmt::format("its scans came from {}, not from {}", kind->kind, input)};
    }
  }
  if (continued >= kMostContinued) {
    return {StatusCode::kUnavailable,
            fmt::format("it has stopped {} times since its last finished sub-map", continued + 1)};
  }
  std::stable_sort(point.marks.begin(), point.marks.end(),
                   [](const Mark& a, const Mark& b) { return a.utime_us < b.utime_us; });
  return {};
}

void remove_half_written(const RunFolder& folder) {
  std::error_code error;
  std::vector<fs::path> left;
  for (const fs::path& place : {folder.path, folder.submaps(), folder.maps()}) {
    for (auto entry = fs::directory_iterator(place, error); !error && entry != end(entry); entry.increment(error)) {
      if (entry->path().filename().string().starts_with('.')) left.push_back(entry->path());
    }
  }
  for (const fs::path& path : left) fs::remove_all(path, error);
}

// A sub-map that was written and not journalled any more is as good as any; anything else under that name is not.
Status adopt_written(const RunFolder& folder, ResumePoint& point) {
  Expected<std::unique_ptr<SubmapArchive>> archive = SubmapArchive::open(folder.submaps(), 0);
  if (!archive) return archive.error();
  for (;;) {
    const auto index = static_cast<std::uint32_t>(point.hashes.size());
    const fs::path path = (*archive)->path_of(index);
    std::error_code error;
    if (!fs::exists(path, error)) break;
    const Expected<std::shared_ptr<const FinishedSubmap>> submap = (*archive)->load(index);
    const Expected<Sha256> hash = sha256_of_file(path);
    if (!submap || !hash || (*submap)->id != SubmapId{folder.cart, folder.run, index}) {
      fs::remove(path, error);
      break;
    }
    point.hashes.push_back(*hash);
    ++point.adopted;
  }
  for (std::uint32_t i = 0; i < point.hashes.size(); ++i) {
    std::error_code error;
    if (!fs::exists((*archive)->path_of(i), error)) {
      return {StatusCode::kCorrupt, (*archive)->path_of(i).string() + " is missing"};
    }
  }
  if (point.hashes.empty()) return {};
  const auto newest = static_cast<std::uint32_t>(point.hashes.size() - 1);
  Expected<std::shared_ptr<const FinishedSubmap>> last = (*archive)->load(newest);
  if (!last) return last.error();
  const Expected<Sha256> hash = sha256_of_file((*archive)->path_of(newest));
  if (!hash || *hash != point.hashes.back() || (*last)->id != SubmapId{folder.cart, folder.run, newest}) {
    return {StatusCode::kCorrupt, (*archive)->path_of(newest).string() + " is not what the journal says"};
  }
  point.last = std::move(*last);
  return {};
}

// The raw scans of a run in some of its files.
class RawScans {
 public:
  RawScans(std::vector<fs::path> files, const Uuid& run, const Channels& channels) {
    const std::string name = files.front().string();
    Expected<std::unique_ptr<tools::ByteSource>> bytes = tools::open_series(std::move(files));
    if (!bytes) return;
    Expected<std::unique_ptr<ScanLog>> log = ScanLog::open(std::move(*bytes), name, channels, run);
    if (log) log_ = std::move(*log);
  }

  // Nothing at the end, or where the disk refuses: what came before counts.
  std::optional<LoggedScan> next() {
    if (!log_) return std::nullopt;
    return log_->next().value_or(std::nullopt);
  }

 private:
  std::unique_ptr<ScanLog> log_;
};

void note_newest(const Channels& channels, const Uuid& run, ResumePoint& point) {
  constexpr std::size_t kEnough = 2;  // files: one may have been begun just then
  std::size_t looked = 0;
  for (auto file = point.raw_files.rbegin(); file != point.raw_files.rend() && looked < kEnough; ++file, ++looked) {
    RawScans scans({*file}, run, channels);
    while (const auto found = scans.next()) {
      std::uint64_t& next = point.next_index[static_cast<std::size_t>(found->role)];
      next = std::max(next, found->message.scan.index + 1);
      std::int64_t& newest = point.last_stamp_us[static_cast<std::size_t>(found->role)];
      newest = std::max(newest, found->message.scan.stamp_us);
    }
  }
  if (!point.last) return;
  const Keyframe& newest = point.last->keyframes.back();
  point.next_index[0] = std::max(point.next_index[0], newest.scan_index + 1);
  point.last_stamp_us[0] = std::max(point.last_stamp_us[0], newest.stamp_us);
}

}  // namespace

Expected<UnfinishedRun> find_unfinished_run(const Configuration& configuration, const std::string& input) {
  const fs::path state = configuration.daemon.state;
  const Expected<fs::path> path = current_run(state);
  if (!path) return failure(path.error());
  UnfinishedRun found;
  found.folder.path = *path;
  found.folder.name = path->filename().string();
  Expected<JournalContents> journal = read_journal(found.folder.journal());
  if (!journal) return failure(journal.error());
  const auto because = [&](const Status& status) {
    return failure(status.code(), fmt::format("run {}: {}", found.folder.name, status.message()));
  };
  if (journal->version != kJournalVersion) {
    return because({StatusCode::kUnavailable, "its journal is of an earlier version"});
  }
  found.folder.cart = journal->cart;
  found.folder.run = journal->run;
  ResumePoint& point = found.point;
  if (Status status = read_records(*journal, input, point); !status.ok()) return because(status);
  point.journal = std::move(*journal);
  remove_half_written(found.folder);
  if (Status status = adopt_written(found.folder, point); !status.ok()) return because(status);
  if (point.last && point.last->cell_m != configuration.mapper.map.cell_m) {
    return because({StatusCode::kUnavailable, "its cells have another size than the configuration says"});
  }
  point.raw_files = tools::raw_files_in(found.folder.path);
  point.next_raw_file = tools::next_raw_number(point.raw_files);
  note_newest(Channels(configuration.lcm.prefix), found.folder.run, point);
  return found;
}

std::function<std::optional<Scan>()> scans_after(const ResumePoint& point, const Uuid& run, const Channels& channels,
                                                 std::optional<std::uint64_t> after) {
  // From the newest file that begins early enough.
  std::vector<fs::path> files = point.raw_files;
  for (std::size_t i = files.size(); after && i-- > 1;) {
    RawScans scans({files[i]}, run, channels);
    std::optional<LoggedScan> first = scans.next();
    while (first && first->role != driver::SensorRole::kHorizontal) first = scans.next();
    if (!first || first->message.scan.index > *after) continue;
    files.erase(files.begin(), files.begin() + static_cast<std::ptrdiff_t>(i));
    break;
  }
  if (files.empty()) return [] { return std::optional<Scan>(); };
  return [scans = std::make_shared<RawScans>(std::move(files), run, channels), after]() -> std::optional<Scan> {
    while (std::optional<LoggedScan> found = scans->next()) {
      if (found->role != driver::SensorRole::kHorizontal || (after && found->message.scan.index <= *after)) continue;
      return std::move(found->message.scan);
    }
    return std::nullopt;
  };
}

}  // namespace submapd
