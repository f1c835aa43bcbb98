#include "daemon/run_journal.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "slam/base/atomic_file.hpp"
#include "slam/base/byte_io.hpp"

namespace submapd {
namespace {

constexpr std::size_t kHeaderBytes = 8 + 4 + 16 + 16 + 4;
constexpr std::size_t kFrameBytes = 4 + 4;  // length before, CRC behind
constexpr std::size_t kMinBody = 1 + 8;     // type, time
constexpr std::size_t kMaxBody = kMinBody + 8 + 4 + kMaxJournalText;

std::uint32_t crc_of(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

void put_text(ByteWriter& out, const std::string& text) {
  out.put(static_cast<std::uint32_t>(text.size()));
  out.put(std::as_bytes(std::span(text)));
}

std::string get_text(ByteReader& in) {
  const std::span<const std::byte> bytes = in.get_bytes(in.get<std::uint32_t>());
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

struct PutEvent {
  ByteWriter& out;
  void operator()(const RunStarted& e) const {
    out.put(e.wall_minus_mono_ns);
    put_text(out, e.version);
  }
  void operator()(const SubmapSaved& e) const {
    out.put(e.index);
    out.put(std::span<const std::uint8_t>(e.hash));
  }
  void operator()(const MarkSet& e) const {
    out.put(e.utime_us);
    put_text(out, e.name);
  }
  void operator()(const MapSaved& e) const { put_text(out, e.name); }
  void operator()(const ScansShed& e) const {
    out.put(e.not_mapped);
    out.put(e.not_recorded);
  }
  void operator()(const RunEnded&) const {}
  void operator()(const RunPaused&) const {}
  void operator()(const RunResumed&) const {}
  void operator()(const RunContinued& e) const {
    out.put(e.wall_minus_mono_ns);
    put_text(out, e.version);
  }
  void operator()(const ClockStepped& e) const { out.put(e.step_ns); }
  void operator()(const InputIs& e) const { put_text(out, e.kind); }
  void operator()(const LandmarksAdded& e) const {
    put_pair(e.tie);
    out.put(e.tie.sigma_m);
    out.put(static_cast<std::uint32_t>(e.tie.points.size()));
    for (const TiePoint& point : e.tie.points) {
      for (const double value : {point.in_a.x(), point.in_a.y(), point.in_b.x(), point.in_b.y()}) out.put(value);
    }
  }
  void operator()(const PairRemoved& e) const { put_pair(e); }
  void operator()(const PairForbidden& e) const { put_pair(e); }
  void operator()(const EditUndone&) const {}
  template <typename Pair>
  void put_pair(const Pair& pair) const {
    out.put(pair.a);
    out.put(pair.b);
  }
};

Sha256 get_hash(ByteReader& in) {
  Sha256 hash{};
  const std::span<const std::byte> bytes = in.get_bytes(hash.size());
  std::transform(bytes.begin(), bytes.end(), hash.begin(),
                 [](std::byte b) { return std::to_integer<std::uint8_t>(b); });
  return hash;
}

template <typename Pair>
void get_pair(ByteReader& in, Pair& pair) {
  pair.a = in.get<std::uint32_t>();
  pair.b = in.get<std::uint32_t>();
}

bool get_tie(ByteReader& in, ManualTie& tie) {
  get_pair(in, tie);
  tie.sigma_m = in.get_f64();
  const auto count = in.get<std::uint32_t>();
  if (count > kMaxTiePoints) return false;
  for (std::uint32_t k = 0; k < count; ++k) {
    TiePoint point;
    for (double* const value : {&point.in_a.x(), &point.in_a.y(), &point.in_b.x(), &point.in_b.y()}) {
      *value = in.get_f64();
    }
    tie.points.push_back(point);
  }
  return true;
}

bool get_event(std::uint8_t type, ByteReader& in, JournalEvent& event) {
  switch (type) {
    case 1: {
      auto& e = event.emplace<RunStarted>();
      e.wall_minus_mono_ns = in.get_i64();
      e.version = get_text(in);
      return true;
    }
    case 2: {
      auto& e = event.emplace<SubmapSaved>();
      e.index = in.get<std::uint32_t>();
      e.hash = get_hash(in);
      return true;
    }
    case 3: {
      auto& e = event.emplace<MarkSet>();
      e.utime_us = in.get_i64();
      e.name = get_text(in);
      return true;
    }
    case 4:
      event.emplace<MapSaved>().name = get_text(in);
      return true;
    case 5: {
      auto& e = event.emplace<ScansShed>();
      e.not_mapped = in.get<std::uint64_t>();
      e.not_recorded = in.get<std::uint64_t>();
      return true;
    }
    case 6:
      event.emplace<RunEnded>();
      return true;
    case 7:
      event.emplace<RunPaused>();
      return true;
    case 8:
      event.emplace<RunResumed>();
      return true;
    case 9: {
      auto& e = event.emplace<RunContinued>();
      e.wall_minus_mono_ns = in.get_i64();
      e.version = get_text(in);
      return true;
    }
    case 10:
      event.emplace<ClockStepped>().step_ns = in.get_i64();
      return true;
    case 11:
      event.emplace<InputIs>().kind = get_text(in);
      return true;
    case 12:
      return get_tie(in, event.emplace<LandmarksAdded>().tie);
    case 13:
      get_pair(in, event.emplace<PairRemoved>());
      return true;
    case 14:
      get_pair(in, event.emplace<PairForbidden>());
      return true;
    case 15:
      event.emplace<EditUndone>();
      return true;
    default:
      return false;
  }
}

constexpr std::array<std::uint8_t, kJournalVersion> kLastTypeOfVersion = {8, 11, 15};

// False: a body whose checksum fits and that is no record.
bool decode_body(std::span<const std::byte> body, std::uint32_t version, JournalRecord& record) {
  ByteReader in(body);
  const auto type = in.get<std::uint8_t>();
  if (type > kLastTypeOfVersion[version - 1]) return false;
  record.utime_us = in.get_i64();
  return get_event(type, in, record.event) && in.ok() && in.remaining() == 0;
}

}  // namespace

std::vector<std::byte> encode_journal_header(const Uuid& cart, const Uuid& run, std::uint32_t version) {
  ByteWriter out;
  out.put(std::as_bytes(std::span(kJournalMagic)));
  out.put(version);
  out.put(std::span<const std::uint8_t>(cart.bytes));
  out.put(std::span<const std::uint8_t>(run.bytes));
  out.put(crc_of(out.bytes()));
  return out.take();
}

std::vector<std::byte> encode_journal_record(const JournalRecord& record) {
  ByteWriter body;
  body.put(static_cast<std::uint8_t>(record.event.index() + 1));
  body.put(record.utime_us);
  std::visit(PutEvent{body}, record.event);
  ByteWriter out;
  out.put(static_cast<std::uint32_t>(body.bytes().size()));
  out.put(std::span<const std::byte>(body.bytes()));
  out.put(crc_of(out.bytes()));
  return out.take();
}

std::vector<std::byte> encode_journal(const Uuid& cart, const Uuid& run, std::span<const JournalRecord> records) {
  std::vector<std::byte> bytes = encode_journal_header(cart, run);
  for (const JournalRecord& record : records) {
    const std::vector<std::byte> more = encode_journal_record(record);
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  return bytes;
}

Expected<JournalContents> decode_journal(std::span<const std::byte> bytes) {
  const auto corrupt = [](std::size_t offset, std::string_view what) {
    return failure(StatusCode::kCorrupt, fmt::format("journal, byte {}: {}", offset, what));
  };
  if (bytes.size() < kHeaderBytes) return corrupt(bytes.size(), "shorter than its header");
  ByteReader header(bytes.first(kHeaderBytes));
  const std::span<const std::byte> magic = header.get_bytes(kJournalMagic.size());
  if (std::memcmp(magic.data(), kJournalMagic.data(), kJournalMagic.size()) != 0)
    return corrupt(0, "no journal of submapd");
  JournalContents contents;
  contents.version = header.get<std::uint32_t>();
  for (Uuid* const id : {&contents.cart, &contents.run}) {
    const std::span<const std::byte> field = header.get_bytes(id->bytes.size());
    std::memcpy(id->bytes.data(), field.data(), field.size());
  }
  if (header.get<std::uint32_t>() != crc_of(bytes.first(kHeaderBytes - 4))) return corrupt(0, "damaged header");
  if (contents.version < 1 || contents.version > kJournalVersion) {
    return corrupt(8, fmt::format("version {}, later than {}", contents.version, kJournalVersion));
  }

  contents.whole_bytes = kHeaderBytes;
  while (contents.whole_bytes < bytes.size()) {
    const std::size_t start = contents.whole_bytes;
    ByteReader in(bytes.subspan(start));
    const auto length = in.get<std::uint32_t>();
    if (in.ok() && (length < kMinBody || length > kMaxBody)) return corrupt(start, "damaged length");
    const std::span<const std::byte> body = in.get_bytes(length);
    const auto crc = in.get<std::uint32_t>();
    if (!in.ok()) break;  // cut off
    const bool last = start + length + kFrameBytes == bytes.size();
    JournalRecord record;
    const bool good = crc == crc_of(bytes.subspan(start, 4 + length)) && decode_body(body, contents.version, record);
    if (!good && last) break;  // blocks of a file reach the disk in any order
    if (!good) return corrupt(start, "damaged record");
    contents.records.push_back(std::move(record));
    contents.whole_bytes = start + length + kFrameBytes;
  }
  return contents;
}

Expected<JournalContents> read_journal(const std::filesystem::path& path) {
  const Expected<std::vector<std::byte>> bytes = read_file(path);
  if (!bytes) return failure(bytes.error());
  Expected<JournalContents> contents = decode_journal(*bytes);
  if (!contents) return failure(StatusCode::kCorrupt, fmt::format("{}: {}", path.string(), contents.error().message()));
  return contents;
}

Expected<std::unique_ptr<RunJournal>> RunJournal::reopen(const std::filesystem::path& path,
                                                         const JournalContents& contents) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (fd < 0) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot open: {}", path.string(), std::strerror(errno)));
  }
  std::unique_ptr<RunJournal> journal(new RunJournal(path, fd));
  journal->bytes_ = static_cast<std::int64_t>(contents.whole_bytes);
  if (::ftruncate(fd, journal->bytes_) != 0) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot cut: {}", path.string(), std::strerror(errno)));
  }
  return journal;
}

Expected<std::unique_ptr<RunJournal>> RunJournal::create(const std::filesystem::path& path, const Uuid& cart,
                                                         const Uuid& run) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0640);
  if (fd < 0) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot make: {}", path.string(), std::strerror(errno)));
  }
  std::unique_ptr<RunJournal> journal(new RunJournal(path, fd));
  if (Status status = journal->write(encode_journal_header(cart, run)); !status.ok()) return failure(status);
  if (Status status = sync_folder(path.parent_path()); !status.ok()) return failure(status);
  return journal;
}

RunJournal::~RunJournal() {
  ::close(fd_);
}

Status RunJournal::append(const JournalRecord& record) {
  return write(encode_journal_record(record));
}

Status RunJournal::write(std::span<const std::byte> bytes) {
  const ssize_t wrote = ::pwrite(fd_, bytes.data(), bytes.size(), bytes_);
  const int error = wrote < 0 ? errno : ENOSPC;
  if (wrote != static_cast<ssize_t>(bytes.size())) {
    (void)!::ftruncate(fd_, bytes_);  // else the next record overwrites the rest
    return {StatusCode::kIo, fmt::format("{}: cannot write: {}", path_.string(), std::strerror(error))};
  }
  bytes_ += wrote;
  if (::fdatasync(fd_) == 0) return {};
  return {StatusCode::kIo, fmt::format("{}: cannot sync: {}", path_.string(), std::strerror(errno))};
}

}  // namespace submapd
