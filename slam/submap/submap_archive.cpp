#include "slam/submap/submap_archive.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>
#include <utility>
#include <vector>

#include "slam/base/atomic_file.hpp"
#include "slam/submap/submap_check.hpp"
#include "slam/submap/submap_codec.hpp"

namespace submapd {
SubmapArchive::SubmapArchive(std::filesystem::path folder, std::size_t cache_bytes_limit) : folder_(std::move(folder)) {
  bytes_.limit = cache_bytes_limit;
}

Expected<std::unique_ptr<SubmapArchive>> SubmapArchive::open(const std::filesystem::path& folder,
                                                             std::size_t cache_bytes_limit) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
    return failure(StatusCode::kIo, fmt::format("{}: cannot make the folder: {}", folder.string(), error.message()));
  return std::unique_ptr<SubmapArchive>(new SubmapArchive(folder, cache_bytes_limit));
}

std::filesystem::path SubmapArchive::path_of(std::uint32_t index) const {
  return folder_ / fmt::format("{:06}.submap", index);
}

Expected<Sha256> SubmapArchive::save(const FinishedSubmap& submap) {
  if (Status status = check_submap(submap); !status.ok()) return failure(std::move(status));
  const std::filesystem::path path = path_of(submap.id.index);
  const std::vector<std::byte> bytes = encode_submap(submap);
  if (bytes.size() > kMaxEncodedSubmapBytes) {
    return failure(StatusCode::kExhausted, fmt::format("{}: {} bytes, above the limit of {}", path.string(),
                                                       bytes.size(), kMaxEncodedSubmapBytes));
  }
  Expected<Sha256> hash = sha256_of(bytes);
  if (!hash) return hash;
  std::error_code error;
  if (std::filesystem::exists(path, error)) {
    const Expected<Sha256> there = sha256_of_file(path);
    if (!there || *there != *hash) {
      return failure(StatusCode::kInvalidArgument, path.string() + ": exists; a finished sub-map never changes");
    }
    // Ours, from a try that failed after the file had its name.
    if (Status status = sync_folder(folder_); !status.ok()) return failure(std::move(status));
    return hash;
  }
  if (Status status = atomic_write_file(path, bytes); !status.ok()) return failure(std::move(status));
  return hash;
}

Expected<std::shared_ptr<const FinishedSubmap>> SubmapArchive::load(std::uint32_t index) {
  if (const auto found = by_index_.find(index); found != by_index_.end()) {
    recent_.splice(recent_.begin(), recent_, found->second);
    return found->second->submap;
  }
  const std::filesystem::path path = path_of(index);
  const Expected<std::vector<std::byte>> bytes = read_file(path, kMaxEncodedSubmapBytes);
  if (!bytes) return failure(bytes.error());
  ++files_read_;
  Expected<FinishedSubmap> decoded = decode_submap(*bytes);
  if (!decoded) {
    return failure(decoded.error().code(), fmt::format("{}: {}", path.string(), decoded.error().message()));
  }
  if (decoded->id.index != index) {
    return failure(StatusCode::kCorrupt, fmt::format("{}: holds sub-map {}", path.string(), decoded->id.index));
  }
  auto submap = std::make_shared<const FinishedSubmap>(std::move(*decoded));
  keep(index, submap);
  return submap;
}

void SubmapArchive::release() {
  by_index_.clear();
  recent_.clear();
  bytes_.used = 0;
}

void SubmapArchive::keep(std::uint32_t index, std::shared_ptr<const FinishedSubmap> submap) {
  const std::size_t bytes = memory_bytes(*submap);
  if (bytes > bytes_.limit) return;
  while (bytes_.used + bytes > bytes_.limit) {
    const Cached& oldest = recent_.back();
    bytes_.used -= oldest.bytes;
    by_index_.erase(oldest.index);
    recent_.pop_back();
  }
  recent_.push_front({index, bytes, std::move(submap)});
  by_index_[index] = recent_.begin();
  bytes_.used += bytes;
  bytes_.peak = std::max(bytes_.peak, bytes_.used);
}

}  // namespace submapd
