#include "tools/verify/verify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "daemon/map_folder.hpp"
#include "daemon/run_journal.hpp"
#include "proto/scan_conversion.hpp"
#include "slam/base/atomic_file.hpp"
#include "slam/base/sha256.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/submap/submap_codec.hpp"
#include "tools/log/log_reader.hpp"
#include "tools/log/raw_series.hpp"

namespace submapd::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class Verifier {
 public:
  explicit Verifier(VerifyReport& report) : report_(report) {}

  void check_run(const fs::path& folder);
  void check_map(const fs::path& folder);
  // `run`: scans of another are wrong; nothing: any.
  void check_log(const fs::path& file, const std::optional<Uuid>& run);
  void check_submap(const fs::path& file, const std::optional<SubmapId>& id, const std::optional<Sha256>& hash);
  void check_poses(const fs::path& file);
  std::optional<JournalContents> check_journal(const fs::path& file);

 private:
  template <typename... Values>
  void problem(const fs::path& file, fmt::format_string<Values...> format, Values&&... values) {
    report_.problems.push_back(file.string() + ": " + fmt::format(format, std::forward<Values>(values)...));
  }
  template <typename... Values>
  void remark(const fs::path& file, fmt::format_string<Values...> format, Values&&... values) {
    report_.remarks.push_back(file.string() + ": " + fmt::format(format, std::forward<Values>(values)...));
  }
  void check_submaps(const fs::path& folder, const JournalContents& journal, bool ended);
  void check_maps(const fs::path& folder);

  VerifyReport& report_;
};

std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (auto entry = fs::directory_iterator(folder, error); !error && entry != end(entry); entry.increment(error)) {
    entries.push_back(entry->path());
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

std::optional<JournalContents> Verifier::check_journal(const fs::path& file) {
  ++report_.files;
  Expected<JournalContents> journal = read_journal(file);
  if (!journal) {
    report_.problems.push_back(journal.error().message());
    return std::nullopt;
  }
  std::error_code error;
  const std::uintmax_t bytes = fs::file_size(file, error);
  if (!error && bytes > journal->whole_bytes) {
    remark(file, "{} bytes behind byte {} are cut off", bytes - journal->whole_bytes, journal->whole_bytes);
  }
  return std::move(*journal);
}

void Verifier::check_submap(const fs::path& file, const std::optional<SubmapId>& id,
                            const std::optional<Sha256>& hash) {
  ++report_.files;
  const Expected<std::vector<std::byte>> bytes = read_file(file, kMaxEncodedSubmapBytes);
  if (!bytes) {
    report_.problems.push_back(bytes.error().message());
    return;
  }
  const Expected<Sha256> is = sha256_of(*bytes);
  if (hash && (!is || *is != *hash)) problem(file, "is not what the journal says: its SHA-256 differs");
  const Expected<FinishedSubmap> submap = decode_submap(*bytes);
  if (!submap) {
    problem(file, "{}", submap.error().message());
  } else if (id && submap->id != *id) {
    problem(file, "holds sub-map {} of run {}", submap->id.index, submap->id.run.to_string());
  }
}

void Verifier::check_poses(const fs::path& file) {
  ++report_.files;
  const Expected<std::vector<std::byte>> bytes = read_file(file);
  if (!bytes) {
    report_.problems.push_back(bytes.error().message());
    return;
  }
  const Expected<PoseSpoolCheck> check = check_pose_spool(*bytes);
  if (!check) {
    problem(file, "{}", check.error().message());
    return;
  }
  const auto rest = std::span(*bytes).subspan(check->whole_bytes);
  const bool zeros = std::all_of(rest.begin(), rest.end(), [](std::byte b) { return b == std::byte{0}; });
  if (rest.empty()) return;
  if (zeros || rest.size() < kPoseRecordBytes) {
    remark(file, "{} bytes behind byte {} are cut off", rest.size(), check->whole_bytes);
  } else {
    problem(file, "byte {}: damaged; {} poses before it are whole", check->whole_bytes, check->records);
  }
}

void Verifier::check_log(const fs::path& file, const std::optional<Uuid>& run) {
  ++report_.files;
  Expected<std::unique_ptr<ByteSource>> bytes = open_file(file.string());
  if (!bytes) {
    report_.problems.push_back(bytes.error().message());
    return;
  }
  std::uint64_t foreign = 0;
  std::map<std::string, std::uint64_t> next;  // number by channel
  std::uint64_t missing = 0;
  auto reader =
      open_log(std::move(*bytes), file.string(),
               [&](std::string_view channel, std::span<const std::byte> data) -> Expected<std::optional<Scan>> {
                 if (!channel.ends_with("_SCAN_H") && !channel.ends_with("_SCAN_V")) {
                   return std::optional<Scan>{};
                 }
                 Expected<ScanMessage> message = decode_scan(data);
                 if (!message) return failure(message.error());
                 if (run && message->origin.run != *run) ++foreign;
                 const auto [due, first] = next.try_emplace(std::string(channel), message->scan.index);
                 if (!first && message->scan.index > due->second) missing += message->scan.index - due->second;
                 due->second = message->scan.index + 1;
                 return std::optional<Scan>(std::move(message->scan));
               });
  std::error_code error;
  if (!reader && run && fs::file_size(file, error) < (std::size_t{1} << 16)) {  // begun just before the power went
    remark(file, "holds no whole scan");
    return;
  }
  if (!reader) {
    problem(file, "{}", reader.error().message());
    return;
  }
  for (;;) {
    const Expected<std::optional<Scan>> scan = (*reader)->next();
    if (!scan) problem(file, "{}", scan.error().message());
    if (!scan || !scan->has_value()) break;
  }
  const LogSummary& summary = (*reader)->summary();
  const std::uint64_t tail = summary.tail_bytes > 0 ? 1 : 0;
  if (tail > 0) remark(file, "its last {} bytes are cut off", summary.tail_bytes);
  if (summary.unreadable_tail) problem(file, "cannot be unpacked to its end");
  if (summary.skipped_records > tail) {
    problem(file, "{} damaged records; first: {}", summary.skipped_records - tail, summary.problems.front());
  }
  if (foreign > 0) problem(file, "{} scans are of another run", foreign);
  if (missing > 0) remark(file, "{} scans are missing between others", missing);
}

void Verifier::check_submaps(const fs::path& folder, const JournalContents& journal, bool ended) {
  std::set<std::string> known;
  std::uint32_t next = 0;
  for (const JournalRecord& record : journal.records) {
    const auto* const saved = std::get_if<SubmapSaved>(&record.event);
    if (saved == nullptr) continue;
    if (saved->index != next) problem(folder / "journal", "sub-map {} stands where {} is due", saved->index, next);
    next = saved->index + 1;
    const std::string name = fmt::format("{:06}.submap", saved->index);
    known.insert(name);
    check_submap(folder / "submaps" / name, SubmapId{journal.cart, journal.run, saved->index}, saved->hash);
  }
  for (const fs::path& file : entries_of(folder / "submaps")) {
    const std::string name = file.filename().string();
    if (known.contains(name)) continue;
    if (name.starts_with('.') || (!ended && name == fmt::format("{:06}.submap", next))) {
      remark(file, "was just being written");
    } else {
      problem(file, "is not in the journal");
    }
  }
}

void Verifier::check_maps(const fs::path& folder) {
  for (const fs::path& map : entries_of(folder)) {
    if (map.filename().string().starts_with('.')) {
      remark(map, "was just being written");
    } else {
      check_map(map);
    }
  }
}

void Verifier::check_run(const fs::path& folder) {
  const std::optional<JournalContents> journal = check_journal(folder / "journal");
  if (journal) {
    const bool ended = std::any_of(journal->records.begin(), journal->records.end(), [](const JournalRecord& record) {
      return std::holds_alternative<RunEnded>(record.event);
    });
    if (!ended)
      remark(folder, "the run has not ended: the daemon is at it, or was cut off and goes on at its next start");
    check_submaps(folder, *journal, ended);
  }
  std::error_code error;
  if (fs::exists(folder / "poses", error)) check_poses(folder / "poses");
  std::optional<Uuid> run;
  if (journal) run = journal->run;
  for (const fs::path& file : raw_files_in(folder)) check_log(file, run);
  check_maps(folder / "maps");
}

void Verifier::check_map(const fs::path& folder) {
  ++report_.files;
  const fs::path path = folder / "MANIFEST";
  const Expected<std::vector<std::byte>> bytes = read_file(path, std::size_t{1} << 20);
  if (!bytes) {
    report_.problems.push_back(bytes.error().message());
    return;
  }
  const auto* const text = reinterpret_cast<const char*>(bytes->data());
  const json manifest = json::parse(text, text + bytes->size(), nullptr, false);
  if (!manifest.is_object() || !manifest.contains("files") || !manifest["files"].is_array() ||
      manifest.value("format", json()) != json(1)) {
    problem(path, "is no manifest of format 1");
    return;
  }
  std::set<std::string> known = {"MANIFEST"};
  for (const json& file : manifest["files"]) {
    const json name = file.is_object() ? file.value("name", json()) : json();
    if (!name.is_string() || !is_name(name.get<std::string>())) {
      problem(path, "lists a file without a proper name");
      continue;
    }
    ++report_.files;
    const fs::path listed = folder / name.get<std::string>();
    known.insert(name.get<std::string>());
    std::error_code error;
    const std::uintmax_t size = fs::file_size(listed, error);
    if (error) {
      problem(listed, "{}", error.message());
      continue;
    }
    if (file.value("bytes", json()) != json(size)) problem(listed, "has {} bytes, not {}", size, file["bytes"].dump());
    const Expected<Sha256> hash = sha256_of_file(listed);
    if (!hash) {
      report_.problems.push_back(hash.error().message());
    } else if (file.value("sha256", json()) != json(hex_of(*hash))) {
      problem(listed, "is not what MANIFEST says: its SHA-256 differs");
    }
  }
  for (const fs::path& file : entries_of(folder)) {
    if (!known.contains(file.filename().string())) problem(file, "is not in MANIFEST");
  }
}

bool begins_with(const fs::path& file, std::string_view magic) {
  std::array<char, 8> front{};
  std::ifstream(file, std::ios::binary).read(front.data(), front.size());
  return std::string_view(front.data(), front.size()) == magic;
}

}  // namespace

Expected<VerifyReport> verify(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) {
    return failure(error ? StatusCode::kIo : StatusCode::kNotFound,
                   path.string() + ": there is no such file or folder");
  }
  VerifyReport report;
  Verifier verifier(report);
  if (fs::is_directory(path, error)) {
    if (fs::exists(path / "journal", error)) {
      report.what = "run";
      verifier.check_run(path);
    } else if (fs::exists(path / "MANIFEST", error)) {
      report.what = "map";
      verifier.check_map(path);
    } else {
      return failure(StatusCode::kInvalidArgument,
                     path.string() + ": is neither a run's folder (no journal) nor a map's (no MANIFEST)");
    }
  } else if (begins_with(path, kJournalMagic)) {
    report.what = "journal";
    (void)verifier.check_journal(path);
  } else if (begins_with(path, kSubmapMagic)) {
    report.what = "sub-map";
    verifier.check_submap(path, std::nullopt, std::nullopt);
  } else if (begins_with(path, kPoseSpoolMagic)) {
    report.what = "poses";
    verifier.check_poses(path);
  } else {
    report.what = "log";
    verifier.check_log(path, std::nullopt);
  }
  return report;
}

}  // namespace submapd::tools
