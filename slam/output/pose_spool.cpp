#include "slam/output/pose_spool.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/base/byte_io.hpp"

namespace submapd {
namespace {

constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kHeaderBytes = 8 + 4 + 4;
constexpr std::size_t kRecordBytes = kPoseRecordBytes;
constexpr std::uint32_t kKeyframe = 1;
constexpr std::uint32_t kLinked = 2;
constexpr std::uint64_t kRecordsAtOnce = 256;

std::uint32_t crc_of(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(
      ::crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

std::vector<std::byte> encode_header() {
  ByteWriter out;
  out.put(std::as_bytes(std::span(kPoseSpoolMagic)));
  out.put(kVersion);
  out.put(crc_of(out.bytes()));
  return out.take();
}

std::vector<std::byte> encode(const SpooledPose& pose) {
  ByteWriter out;
  out.put(pose.stamp_us);
  out.put(pose.keyframe_scan_index);
  for (const Pose2* const p : {&pose.keyframe_from_base, &pose.previous_keyframe_from_base}) {
    out.put(p->x);
    out.put(p->y);
    out.put(p->yaw);
  }
  out.put((pose.keyframe ? kKeyframe : 0U) | (pose.linked ? kLinked : 0U));
  out.put(crc_of(out.bytes()));
  return out.take();
}

// Nothing for a damaged record.
std::optional<SpooledPose> decode(std::span<const std::byte> record) {
  ByteReader in(record);
  SpooledPose pose;
  pose.stamp_us = in.get_i64();
  pose.keyframe_scan_index = in.get<std::uint64_t>();
  for (Pose2* const p : {&pose.keyframe_from_base, &pose.previous_keyframe_from_base}) {
    p->x = in.get_f64();
    p->y = in.get_f64();
    p->yaw = in.get_f64();
  }
  const auto flags = in.get<std::uint32_t>();
  pose.keyframe = (flags & kKeyframe) != 0;
  pose.linked = (flags & kLinked) != 0;
  if (in.get<std::uint32_t>() != crc_of(record.first(kRecordBytes - 4)) || flags > (kKeyframe | kLinked)) {
    return std::nullopt;
  }
  return pose;
}

off_t offset_of(std::uint64_t record) {
  return static_cast<off_t>(kHeaderBytes + record * kRecordBytes);
}

Status disk_error(const char* what, int error) {
  return {StatusCode::kIo, fmt::format("cannot {} the poses of scans: {}", what, std::strerror(error))};
}

}  // namespace

Expected<std::unique_ptr<PoseSpool>> PoseSpool::create(const std::filesystem::path& folder) {
  std::string name = (folder / ".poses.XXXXXX").string();
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0) {
    return failure(StatusCode::kIo,
                   fmt::format("cannot make a temporary file in {}: {}", folder.string(), std::strerror(errno)));
  }
  ::unlink(name.c_str());
  std::unique_ptr<PoseSpool> spool(new PoseSpool(fd));
  if (Status status = spool->begin_file(); !status.ok()) return failure(status);
  return spool;
}

Expected<std::unique_ptr<PoseSpool>> PoseSpool::open(const std::filesystem::path& path) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (fd < 0) {
    return failure(StatusCode::kIo, fmt::format("{}: cannot open: {}", path.string(), std::strerror(errno)));
  }
  std::unique_ptr<PoseSpool> spool(new PoseSpool(fd));
  const off_t bytes = ::lseek(fd, 0, SEEK_END);
  // Shorter than a header: the file was made just before the power went.
  Status status = bytes < static_cast<off_t>(kHeaderBytes) ? spool->begin_file() : spool->check_header();
  if (status.ok()) status = spool->keep_until(std::numeric_limits<std::int64_t>::max());
  if (status.ok()) status = sync_folder(path.parent_path());
  if (!status.ok()) return failure(status.code(), fmt::format("{}: {}", path.string(), status.message()));
  return spool;
}

PoseSpool::~PoseSpool() {
  ::close(fd_);
}

Status PoseSpool::begin_file() {
  const std::vector<std::byte> header = encode_header();
  const ssize_t wrote = ::pwrite(fd_, header.data(), header.size(), 0);
  return wrote == static_cast<ssize_t>(header.size()) ? Status() : disk_error("write", wrote < 0 ? errno : ENOSPC);
}

Status PoseSpool::check_header() const {
  std::array<std::byte, kHeaderBytes> header{};
  if (::pread(fd_, header.data(), header.size(), 0) != static_cast<ssize_t>(header.size())) {
    return disk_error("read", errno);
  }
  if (!std::ranges::equal(header, encode_header())) return {StatusCode::kCorrupt, "holds no poses of scans"};
  return {};
}

Status PoseSpool::keep_until(std::int64_t until_us) {
  last_stamp_us_ = std::numeric_limits<std::int64_t>::min();
  std::vector<std::byte> block(kRecordsAtOnce * kRecordBytes);
  std::uint64_t records = 0;
  for (bool more = true; more;) {
    const ssize_t got = ::pread(fd_, block.data(), block.size(), offset_of(records));
    if (got < 0) return disk_error("read", errno);
    const std::size_t whole = static_cast<std::size_t>(got) / kRecordBytes;
    more = whole == kRecordsAtOnce;
    for (std::size_t i = 0; i < whole; ++i) {
      const std::optional<SpooledPose> pose = decode(std::span(block).subspan(i * kRecordBytes, kRecordBytes));
      more = more && pose && pose->stamp_us <= until_us;
      if (!pose || pose->stamp_us > until_us) break;
      last_stamp_us_ = pose->stamp_us;
      ++records;
    }
  }
  if (::ftruncate(fd_, offset_of(records)) != 0) return disk_error("cut", errno);
  size_.store(records, std::memory_order_release);
  return {};
}

Status PoseSpool::add(const SpooledPose& pose) {
  const std::uint64_t record = size_.load(std::memory_order_relaxed);
  const std::vector<std::byte> bytes = encode(pose);
  const ssize_t wrote = ::pwrite(fd_, bytes.data(), bytes.size(), offset_of(record));
  if (wrote != static_cast<ssize_t>(bytes.size())) {
    const int error = wrote < 0 ? errno : ENOSPC;
    (void)!::ftruncate(fd_, offset_of(record));  // else the next record overwrites the rest
    return disk_error("write", error);
  }
  last_stamp_us_ = pose.stamp_us;
  size_.store(record + 1, std::memory_order_release);
  return {};
}

Status PoseSpool::sync() {
  return ::fdatasync(fd_) == 0 ? Status() : disk_error("sync", errno);
}

Status PoseSpool::for_each(std::uint64_t count, const std::function<Status(const SpooledPose&)>& visit) const {
  const std::uint64_t at_once = std::min(count, kRecordsAtOnce);
  std::vector<std::byte> block(at_once * kRecordBytes);
  for (std::uint64_t first = 0; first < count; first += at_once) {
    const std::uint64_t some = std::min(at_once, count - first);
    const std::size_t bytes = some * kRecordBytes;
    if (::pread(fd_, block.data(), bytes, offset_of(first)) != static_cast<ssize_t>(bytes)) {
      return {StatusCode::kIo, "cannot read the poses of scans back"};
    }
    for (std::uint64_t i = 0; i < some; ++i) {
      const std::optional<SpooledPose> pose = decode(std::span(block).subspan(i * kRecordBytes, kRecordBytes));
      if (!pose) return {StatusCode::kCorrupt, fmt::format("the pose of scan {} is damaged on the disk", first + i)};
      if (Status status = visit(*pose); !status.ok()) return status;
    }
  }
  return {};
}

Expected<PoseSpoolCheck> check_pose_spool(std::span<const std::byte> bytes) {
  if (bytes.size() < kHeaderBytes || !std::ranges::equal(bytes.first(kHeaderBytes), encode_header())) {
    return failure(StatusCode::kCorrupt, "holds no poses of scans");
  }
  PoseSpoolCheck check{0, kHeaderBytes};
  while (bytes.size() - check.whole_bytes >= kRecordBytes && decode(bytes.subspan(check.whole_bytes, kRecordBytes))) {
    ++check.records;
    check.whole_bytes += kRecordBytes;
  }
  return check;
}

}  // namespace submapd
