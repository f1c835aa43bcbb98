// What happened in a run, in order, for ever: the file `journal` (journal-format.md).
//
// Append-only, a checksum for each record, on the disk when append() returns. A cut-off last record, as a power cut
// leaves it, is left out when the file is read. One thread writes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/sha256.hpp"
#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd {

inline constexpr std::uint32_t kJournalVersion = 3;
inline constexpr std::size_t kMaxJournalText = 1024;

struct RunStarted {
  std::int64_t wall_minus_mono_ns = 0;  // frozen for the run
  std::string version;                  // of the program
  friend bool operator==(const RunStarted&, const RunStarted&) = default;
};
struct SubmapSaved {
  std::uint32_t index = 0;
  Sha256 hash{};  // of the file in submaps/
  friend bool operator==(const SubmapSaved&, const SubmapSaved&) = default;
};
struct MarkSet {
  std::int64_t utime_us = 0;  // the instant that is marked
  std::string name;
  friend bool operator==(const MarkSet&, const MarkSet&) = default;
};
struct MapSaved {
  std::string name;
  friend bool operator==(const MapSaved&, const MapSaved&) = default;
};
// Scans that were received and not used since the run began.
struct ScansShed {
  std::uint64_t not_mapped = 0;
  std::uint64_t not_recorded = 0;
  friend bool operator==(const ScansShed&, const ScansShed&) = default;
};
struct RunEnded {
  friend bool operator==(const RunEnded&, const RunEnded&) = default;
};

// After a crash or a power cut: what follows comes from another process.
struct RunContinued {
  std::int64_t wall_minus_mono_ns = 0;  // frozen from here on
  std::string version;
  friend bool operator==(const RunContinued&, const RunContinued&) = default;
};
// Somebody set the system's clock. Stamps of the run do not follow.
struct ClockStepped {
  std::int64_t step_ns = 0;  // the system's clock now is ahead of where it was by this
  friend bool operator==(const ClockStepped&, const ClockStepped&) = default;
};
// Where the scans come from: a run goes on only with scans from the same kind of source.
struct InputIs {
  std::string kind;  // "usb", "lcm" or "file"
  friend bool operator==(const InputIs&, const InputIs&) = default;
};

struct RunPaused {
  friend bool operator==(const RunPaused&, const RunPaused&) = default;
};
struct RunResumed {
  friend bool operator==(const RunResumed&, const RunResumed&) = default;
};

// What a person has decided about the graph of a run that has ended (submapctl landmarks); pairs are (a, b), a < b.
inline constexpr std::size_t kMaxTiePoints = 24;
struct LandmarksAdded {
  ManualTie tie;
  friend bool operator==(const LandmarksAdded&, const LandmarksAdded&) = default;
};
// What ties the pair, added or found, does no longer; it may be tied by hand.
struct PairRemoved {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  friend bool operator==(const PairRemoved&, const PairRemoved&) = default;
};
// The same, and nothing may tie it any more.
struct PairForbidden {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  friend bool operator==(const PairForbidden&, const PairForbidden&) = default;
};
// The newest of the three above that is not undone does not count.
struct EditUndone {
  friend bool operator==(const EditUndone&, const EditUndone&) = default;
};

// In the order of their numbers in the file, from 1.
using JournalEvent =
    std::variant<RunStarted, SubmapSaved, MarkSet, MapSaved, ScansShed, RunEnded, RunPaused, RunResumed, RunContinued,
                 ClockStepped, InputIs, LandmarksAdded, PairRemoved, PairForbidden, EditUndone>;

struct JournalRecord {
  std::int64_t utime_us = 0;  // when it was written
  JournalEvent event;
  friend bool operator==(const JournalRecord&, const JournalRecord&) = default;
};

inline constexpr std::string_view kJournalMagic = "SMAPJRNL";  // a journal begins with this

struct JournalContents {
  std::uint32_t version = kJournalVersion;
  Uuid cart;
  Uuid run;
  std::vector<JournalRecord> records;
  std::size_t whole_bytes = 0;  // up to the end of the last whole record
};

[[nodiscard]] std::vector<std::byte> encode_journal_header(const Uuid& cart, const Uuid& run,
                                                           std::uint32_t version = kJournalVersion);
// REQUIRES: texts of at most kMaxJournalText bytes, ties of at most kMaxTiePoints points.
[[nodiscard]] std::vector<std::byte> encode_journal_record(const JournalRecord& record);
// A whole file of this version.
[[nodiscard]] std::vector<std::byte> encode_journal(const Uuid& cart, const Uuid& run,
                                                    std::span<const JournalRecord> records);

// Errors: kCorrupt (no journal, a later version, or damage before the last record).
[[nodiscard]] Expected<JournalContents> decode_journal(std::span<const std::byte> bytes);
// The same of a file; the message has its path. Errors: kIo, kCorrupt.
[[nodiscard]] Expected<JournalContents> read_journal(const std::filesystem::path& path);

class RunJournal {
 public:
  // Errors: kIo; also if the file exists.
  [[nodiscard]] static Expected<std::unique_ptr<RunJournal>> create(const std::filesystem::path& path, const Uuid& cart,
                                                                    const Uuid& run);
  // Goes on behind the last whole record of a journal that was read; what is cut off behind it is removed.
  // REQUIRES: contents.version is kJournalVersion. Errors: kIo.
  [[nodiscard]] static Expected<std::unique_ptr<RunJournal>> reopen(const std::filesystem::path& path,
                                                                    const JournalContents& contents);
  RunJournal(const RunJournal&) = delete;
  RunJournal& operator=(const RunJournal&) = delete;
  ~RunJournal();

  // After an error the file ends with the last whole record.
  Status append(const JournalRecord& record);

 private:
  RunJournal(std::filesystem::path path, int fd) : path_(std::move(path)), fd_(fd) {}
  Status write(std::span<const std::byte> bytes);

  const std::filesystem::path path_;
  const int fd_;
  std::int64_t bytes_ = 0;
};

}  // namespace submapd
